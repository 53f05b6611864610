#pragma once
#include <stddef.h>
#include <stdint.h>
#define M2T(milliseconds) ((uint32_t)(milliseconds))
#define T2M(ticks) ((uint32_t)(ticks))
typedef uint32_t StackType_t;
typedef unsigned long UBaseType_t;
typedef struct { uint32_t none; } StaticTask_t;
