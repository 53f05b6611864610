/* An autopilot's own interface around a policy, behind the processor-in-the-loop protocol: adapter.c has the protocol on standard
 * input and output, an adapter what is declared here. `kestrel evaluate RUN --processor program --image ADAPTER` flies it. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* What the simulator knows of the drone in a control period: world x forward, y left, z up, as the body. */
typedef struct {
  float position[3];    /* m */
  float attitude[4];    /* w, x, y, z, from body to world */
  float velocity[3];    /* m/s, world */
  float body_rates[3];  /* rad/s */
  float goal[3];        /* m */
  float heading;        /* rad, counter-clockwise from x */
} AdapterTick;

/* The policy that the simulator flies beside: 0 if the adapter has the same, else a code. */
int32_t adapter_take(const uint8_t *policy, size_t len);

/* An episode begins. */
void adapter_reset(void);

/* Rotor speeds (rad/s) front right, rear right, rear left, front left, beside what sensors measured; 0, or why there are none. */
int32_t adapter_tick(const AdapterTick *tick, const float *measurements, size_t count, float speeds[4]);
