/* A log variable is a pointer that a test can read; those of the firmware's rangers are numbered as a test says. */
#pragma once
#include <stdint.h>

typedef uint16_t logVarId_t;
#define LOG_VARID_IS_VALID(ID) ((ID) != 0xffffu)
logVarId_t logGetVarId(char *group, char *name);
unsigned int logGetUint(logVarId_t id);

#define LOG_GROUP_START(NAME)
#define LOG_ADD(TYPE, NAME, ADDRESS) \
  extern const void *const log_##NAME; \
  const void *const log_##NAME = (ADDRESS);
#define LOG_GROUP_STOP(NAME)
