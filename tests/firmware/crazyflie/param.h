/* A parameter is a pointer that a test can write to. */
#pragma once
#define PARAM_GROUP_START(NAME)
#define PARAM_ADD(TYPE, NAME, ADDRESS) \
  extern void *const param_##NAME; \
  void *const param_##NAME = (ADDRESS);
#define PARAM_GROUP_STOP(NAME)
