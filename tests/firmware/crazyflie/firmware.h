/* The clock of the firmware around the app. */
#pragma once
#include <stdint.h>

/* Milliseconds. */
extern uint32_t now;
