/* Written by `kestrel export --target betaflight`; see nn_controller.h. */
#include "nn_controller.h"

#include <math.h>
#include <string.h>

#include "kestrel.h"
#include "kestrel_guard.h"
#include "policy.h"

#define MICROSECONDS 1000000u

/* One lost sample is forgiven; 10 ms is less than an attitude loop needs. */
#define HOLD_US 10000u

/* An angle beyond two turns is none that an estimator says. */
#define ANGLE_LIMIT 12.6f

/* Of a drone that nothing is known of: what its motors should give at half their command. */
#define DOUBLE_WEIGHT 2.0f

const float start_pos[3] = NN_START_POSITION;
const float start_yaw = NN_START_YAW;

uint32_t nn_calls_hz = 0;
float nn_thrust_to_weight = 0.0f;
float nn_motor_nonlinearity = 0.5f;
uint32_t nn_goal_timeout_us = 0;

static KestrelPilot pilot;
static bool tested = false;
static int32_t refusal = KESTREL_NO_POLICY;

static KestrelGuard guard;
static float goal[4];
static uint32_t goal_age_us;

/* Calls since the last action; why there was none, and what it commanded. */
static uint32_t calls;
static int32_t answer = KESTREL_NO_POLICY;
static float commands[4];

int32_t nn_test(void) {
  if (!tested) {
    refusal = kestrel_take_policy(&pilot, kestrel_policy, kestrel_policy_len);
    tested = true;
  }
  return refusal;
}

void nn_set_goal(const float position[3], float yaw) {
  /* From north, east, down to forward, left, up. */
  goal[0] = position[0];
  goal[1] = -position[1];
  goal[2] = -position[2];
  goal[3] = -yaw;
  goal_age_us = 0;
}

void nn_reset(void) {
  (void)nn_test();
  memset(&guard, 0, sizeof guard);
  guard.hold_us = HOLD_US;
  answer = KESTREL_NO_POLICY;
  nn_set_goal(start_pos, start_yaw);
}

/* What the motors have to be told to carry so many quarters of the weight, in the order front right, rear right, rear left, front
 * left. Where one would have to give more than it can, all give less: the moment counts more than the thrust. */
static void command(const float quarter_weights[4]) {
  static const int motor[4] = {1, 0, 2, 3};
  const float known = nn_thrust_to_weight > 0.0f ? nn_thrust_to_weight : kestrel_greatest_thrust(&pilot);
  const float greatest = known > 0.0f ? known : DOUBLE_WEIGHT;
  const float k = nn_motor_nonlinearity, linear = 1.0f - k;
  float excess = 0.0f;
  for (int rotor = 0; rotor < 4; rotor++) {
    const float over = quarter_weights[rotor] - greatest;
    excess = over > excess ? over : excess;
  }
  for (int rotor = 0; rotor < 4; rotor++) {
    const float left = quarter_weights[rotor] - excess;
    const float share = left > 0.0f ? left / greatest : 0.0f;
    commands[motor[rotor]] = k > 0.01f ? (sqrtf(linear * linear + 4.0f * k * share) - linear) / (2.0f * k) : share;
  }
}

/* Also what is not a number: told by the bits, because a compiler with -ffast-math takes every comparison for one of finite
 * numbers. */
static bool is_angle(float value) {
  const float limit = ANGLE_LIMIT;
  uint32_t magnitude, most;
  memcpy(&magnitude, &value, sizeof magnitude);
  memcpy(&most, &limit, sizeof most);
  return (magnitude & 0x7fffffffu) <= most;
}

/* From body to world in forward, left, up, of angles in forward, right, down. */
static void attitude_of(const float angles[3], float attitude[4]) {
  const float cr = cosf(0.5f * angles[0]), sr = sinf(0.5f * angles[0]);
  const float cp = cosf(0.5f * angles[1]), sp = sinf(0.5f * angles[1]);
  const float cy = cosf(0.5f * angles[2]), sy = sinf(0.5f * angles[2]);
  attitude[0] = cr * cp * cy + sr * sp * sy;
  attitude[1] = sr * cp * cy - cr * sp * sy;
  attitude[2] = -(cr * sp * cy + sr * cp * sy);
  attitude[3] = -(cr * cp * sy - sr * sp * cy);
}

static int32_t act(const float world_state[16], float thrusts[4]) {
  const float towards[4] = {goal[0], goal[1], goal[2], goal[3]};
  KestrelState state;
  float answered[4];
  if (!is_angle(world_state[6]) || !is_angle(world_state[7]) || !is_angle(world_state[8])) {
    return KESTREL_ATTITUDE;
  }
  /* From north, east, down and forward, right, down to forward, left, up. */
  for (int axis = 0; axis < 3; axis++) {
    const float side = axis == 0 ? 1.0f : -1.0f;
    state.position[axis] = side * world_state[axis];
    state.velocity[axis] = side * world_state[3 + axis];
    state.body_rates[axis] = side * world_state[9 + axis];
  }
  attitude_of(world_state + 6, state.attitude);
  const int32_t result = kestrel_tick(&pilot, &state, &towards, &answered);
  if (result == KESTREL_OK) {
    memcpy(thrusts, answered, sizeof answered);
    command(thrusts);
  }
  return result;
}

/* What a policy with a rate loop does between two actions; others hold. */
static void follow(const float world_state[16], float (*thrusts)[4]) {
  const float rates[3] = {world_state[9], -world_state[10], -world_state[11]};
  if (kestrel_follow_rates(&pilot, &rates, thrusts) == KESTREL_OK) {
    command(*thrusts);
  }
}

static uint32_t calls_per_second(float period_secs) {
  return nn_calls_hz != 0 ? nn_calls_hz : (uint32_t)(1.0f / period_secs + 0.5f);
}

void nn_control(const float world_state[16], float motor_cmds[4]) {
  static const float hover[4] = {1.0f, 1.0f, 1.0f, 1.0f};
  static float thrusts[4];
  const float period_secs = nn_test() == KESTREL_OK ? kestrel_control_period(&pilot) : 1.0f;
  const uint32_t hz = calls_per_second(period_secs);
  const uint32_t calls_per_action = (uint32_t)(period_secs * (float)hz + 0.5f);
  const uint32_t call_us = MICROSECONDS / hz;
  /* A state that was refused is asked again in every call, which takes no inference. */
  if (answer != KESTREL_OK || ++calls >= calls_per_action) {
    if (!guard.flies) {
      kestrel_reset(&pilot);
    }
    answer = refusal == KESTREL_OK ? act(world_state, thrusts) : refusal;
    calls = 0;
  } else {
    follow(world_state, &thrusts);
  }
  goal_age_us = goal_age_us + call_us < goal_age_us ? UINT32_MAX : goal_age_us + call_us;
  guard.stale_us = nn_goal_timeout_us;
  if (kestrel_guard(&guard, answer, goal_age_us, call_us) == KESTREL_HAND_OVER) {
    command(hover);
  }
  memcpy(motor_cmds, commands, sizeof commands);
}

int32_t nn_status(void) { return guard.code; }

bool nn_flies(void) { return guard.flies != 0; }
