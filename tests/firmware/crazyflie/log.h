/* A log variable is a pointer that a test can read. */
#pragma once
#define LOG_GROUP_START(NAME)
#define LOG_ADD(TYPE, NAME, ADDRESS) \
  extern const void *const log_##NAME; \
  const void *const log_##NAME = (ADDRESS);
#define LOG_GROUP_STOP(NAME)
