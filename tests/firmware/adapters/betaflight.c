/* INDIflight's neural interface: north, east, down, Euler angles, commands of 0 to 1 in the order of QUADX. */
#include <math.h>
#include <string.h>

#include "adapter.h"
#include "kestrel.h"
#include "nn_controller.h"
#include "policy.h"

/* Another policy than the one that was compiled in. */
#define OTHER_POLICY 110

/* Of the airframe crazyflie_2_1: mass (kg), gravity (m/s^2), thrust per squared speed (N s^2), greatest speed (rad/s). */
#define MASS 0.027f
#define GRAVITY 9.8f
#define THRUST_COEFFICIENT 2.8815e-8f
#ifndef GREATEST_SPEED
#define GREATEST_SPEED 2224.0f
#endif

/* The inner loop calls faster than the policy acts. */
#define CALLS_PER_SECOND 500
#define CALLS 10

static float motor_cmds[4];

int32_t adapter_take(const uint8_t *policy, size_t len) {
  nn_calls_hz = CALLS_PER_SECOND;
  nn_goal_timeout_us = 500000;
  nn_thrust_to_weight = 4.0f * THRUST_COEFFICIENT * GREATEST_SPEED * GREATEST_SPEED / (MASS * GRAVITY);
  if (len != kestrel_policy_len || memcmp(policy, kestrel_policy, len) != 0) {
    return OTHER_POLICY;
  }
  return nn_test();
}

void adapter_reset(void) { nn_reset(); }

static void euler_of(const float q[4], float angles[3]) {
  const float w = q[0], x = q[1], y = -q[2], z = -q[3];
  const float sine = 2.0f * (w * y - z * x);
  angles[0] = atan2f(2.0f * (w * x + y * z), 1.0f - 2.0f * (x * x + y * y));
  angles[1] = asinf(sine < -1.0f ? -1.0f : sine > 1.0f ? 1.0f : sine);
  angles[2] = atan2f(2.0f * (w * z + x * y), 1.0f - 2.0f * (y * y + z * z));
}

/* A motor of this thrust at full command runs so fast. */
static float speed_of(float command) {
  const float k = nn_motor_nonlinearity;
  return GREATEST_SPEED * sqrtf(k * command * command + (1.0f - k) * command);
}

int32_t adapter_tick(const AdapterTick *tick, const float *measurements, size_t count, float speeds[4]) {
  (void)measurements, (void)count;
  float world_state[16] = {0.0f};
  const float goal[3] = {tick->goal[0], -tick->goal[1], -tick->goal[2]};
  for (int axis = 0; axis < 3; axis++) {
    const float side = axis == 0 ? 1.0f : -1.0f;
    world_state[axis] = side * tick->position[axis];
    world_state[3 + axis] = side * tick->velocity[axis];
    world_state[9 + axis] = side * tick->body_rates[axis];
  }
  euler_of(tick->attitude, world_state + 6);
  nn_set_goal(goal, -tick->heading);
  for (int call = 0; call < CALLS; call++) {
    nn_control(world_state, motor_cmds);
    if (!nn_flies()) return nn_status();
  }
  speeds[0] = speed_of(motor_cmds[1]);
  speeds[1] = speed_of(motor_cmds[0]);
  speeds[2] = speed_of(motor_cmds[2]);
  speeds[3] = speed_of(motor_cmds[3]);
  return 0;
}
