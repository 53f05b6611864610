#pragma once
#include <stdio.h>
#define DEBUG_PRINT(...) printf(DEBUG_MODULE ": " __VA_ARGS__)
