#pragma once
#include <stdio.h>
/* Standard output, unless a test needs that for itself. */
#ifndef DEBUG_STREAM
#define DEBUG_STREAM stdout
#endif
#define DEBUG_PRINT(...) fprintf(DEBUG_STREAM, DEBUG_MODULE ": " __VA_ARGS__)
