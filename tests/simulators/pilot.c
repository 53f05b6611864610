/* A policy for many drones at once, as a shared library that Python loads: the core's pilot (libkestrel_pilot.a), observation,
 * network, rate loop and mixer. */
#include <stdlib.h>
#include <string.h>

#include "kestrel.h"

static KestrelPilot *pilots;
static uint8_t *policy;
static size_t drones;

/* So many pilots with a policy each, in place of those before. Returns KESTREL_OK or why the policy is refused. */
int32_t simulators_begin(const uint8_t *bytes, size_t len, size_t count) {
  free(pilots);
  free(policy);
  drones = count;
  pilots = calloc(count, sizeof *pilots);
  policy = malloc(len);
  if (pilots == NULL || policy == NULL) {
    abort();
  }
  memcpy(policy, bytes, len);
  int32_t refusal = KESTREL_OK;
  for (size_t drone = 0; drone < drones && refusal == KESTREL_OK; drone++) {
    refusal = kestrel_take_policy(&pilots[drone], policy, len);
    kestrel_reset(&pilots[drone]);
  }
  return refusal;
}

/* Seconds between two ticks. */
float simulators_period(void) { return kestrel_control_period(&pilots[0]); }

/* One control period of all drones, each to its goal; how many were refused, whose thrusts are zero. */
size_t simulators_tick(const KestrelState *states, const float (*goals)[4], float (*thrusts)[4]) {
  size_t refused = 0;
  for (size_t drone = 0; drone < drones; drone++) {
    refused += kestrel_tick(&pilots[drone], &states[drone], &goals[drone], &thrusts[drone]) != KESTREL_OK;
  }
  return refused;
}
