/* A policy of Kestrel as the out-of-tree controller of crazyflie-firmware.
 *
 * The policy flies while the set-point is a fresh position; everything else, and whatever the policy cannot fly, is left to
 * the firmware's own PID controller. A policy that does not compute here what it did where it was exported is refused, and
 * the Crazyflie does not arm.
 *
 * Parameters (group kestrel): `enable`, 0 leaves everything to the PID controller. Logs: `answer` (why the policy does not
 * fly, 0 if it does), `flying`, `held` (ticks for which the last thrusts were held), `m1` ... `m4` (thrust in quarters of the
 * weight).
 */
#include <stdbool.h>
#include <stdint.h>

#include "app.h"

#include "FreeRTOS.h"
#include "task.h"

#include "controller.h"
#include "controller_pid.h"
#include "log.h"
#include "param.h"
#include "platform_defaults.h"

#define DEBUG_MODULE "KESTREL"
#include "debug.h"

#include "kestrel.h"
#include "policy.h"

#define RADIANS_PER_DEGREE 0.017453292519943295f
#define GRAVITY 9.81f /* m/s^2 */

/* A quarter of the drone's weight as a share of the greatest thrust of a motor, both as this firmware has them. */
#define SHARE_OF_QUARTER_WEIGHT (0.25f * CF_MASS * GRAVITY / THRUST_MAX)

/* While a state is refused, the last thrusts are held so long before the PID controller takes over: one lost sample is
 * forgiven, and 10 ms is less than an attitude loop needs. */
#define HOLD_TICKS M2T(10)

/* A set-point that is older is no order any more: twice the time-out of the firmware's own commander. */
#define STALE_TICKS M2T(1000)

static KestrelPilot pilot;
static int32_t refusal = KESTREL_NO_POLICY;

/* Reading a policy takes up to 6 KB of stack, once; the task that starts the system has 1.2. */
#define READING_STACK_WORDS 2048
static StackType_t reading_stack[READING_STACK_WORDS];
static StaticTask_t reading_task;
static volatile bool has_read;

/* Ticks of the stabilizer from one action to the next. */
static uint32_t period = 1;

/* Of the last action that the policy answered. */
static float thrusts[4];
static int32_t answer = KESTREL_NO_POLICY;
static uint32_t held;

/* Whether the policy flew at the last tick. */
static uint8_t flying;

/* Where the nose shall point: deg, as the set-points have it, counter-clockwise. */
static float heading;

static uint8_t enable = 1;

void appMain(void) {
  while (true) {
    vTaskDelay(M2T(2000));
  }
}

static void read_policy(void *nothing) {
  (void)nothing;
  refusal = kestrel_take_policy(&pilot, kestrel_policy, kestrel_policy_len);
  has_read = true;
  vTaskDelete(NULL);
}

void controllerOutOfTreeInit(void) {
  controllerPidInit();
  flying = 0;
  if (has_read) {
    return;
  }
  xTaskCreateStatic(read_policy, "KESTREL", READING_STACK_WORDS, NULL, uxTaskPriorityGet(NULL), reading_stack, &reading_task);
  while (!has_read) {
    vTaskDelay(1);
  }
  period = (uint32_t)(kestrel_control_period(&pilot) * RATE_MAIN_LOOP + 0.5f);
  if (period == 0) {
    period = 1;
  }
}

/* What a firmware of another drone would get wrong is said before it arms. */
static bool can_carry(void) {
  const int percent_here = (int)(100.0f / SHARE_OF_QUARTER_WEIGHT);
  const int percent_trained = (int)(100.0f * kestrel_greatest_thrust(&pilot));
  DEBUG_PRINT("%d g, %d mN a motor: thrust %d %% of the weight, trained with %d %%\n", (int)(1000.0f * CF_MASS + 0.5f),
              (int)(1000.0f * THRUST_MAX + 0.5f), percent_here, percent_trained);
  return percent_here > 110;
}

bool controllerOutOfTreeTest(void) {
  if (refusal != KESTREL_OK) {
    DEBUG_PRINT("policy refused: %d\n", (int)refusal);
    return false;
  }
  if (!can_carry()) {
    DEBUG_PRINT("the motors cannot carry the drone\n");
    return false;
  }
  return controllerPidTest();
}

static bool is_fresh_position(const setpoint_t *setpoint) {
  const bool is_position = setpoint->mode.x == modeAbs && setpoint->mode.y == modeAbs && setpoint->mode.z == modeAbs;
  return is_position && xTaskGetTickCount() - setpoint->timestamp < STALE_TICKS;
}

/* The heading of the set-point, as the stock controller takes it: an angle, a rate, or what it was when it began. */
static void turn(const setpoint_t *setpoint) {
  if (setpoint->mode.yaw == modeAbs) {
    heading = setpoint->attitude.yaw;
  } else if (setpoint->mode.yaw == modeVelocity) {
    heading += setpoint->attitudeRate.yaw * (float)period / RATE_MAIN_LOOP;
    heading -= 360.0f * (float)((heading > 180.0f) - (heading < -180.0f));
  }
}

static int32_t act(const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state) {
  turn(setpoint);
  const float goal[4] = {setpoint->position.x, setpoint->position.y, setpoint->position.z, RADIANS_PER_DEGREE * heading};
  const KestrelState here = {
      .position = {state->position.x, state->position.y, state->position.z},
      .attitude = {state->attitudeQuaternion.w, state->attitudeQuaternion.x, state->attitudeQuaternion.y,
                   state->attitudeQuaternion.z},
      .velocity = {state->velocity.x, state->velocity.y, state->velocity.z},
      .body_rates = {RADIANS_PER_DEGREE * sensors->gyro.x, RADIANS_PER_DEGREE * sensors->gyro.y,
                     RADIANS_PER_DEGREE * sensors->gyro.z},
  };
  float wanted[4];
  const int32_t result = kestrel_tick(&pilot, &here, &goal, &wanted);
  if (result == KESTREL_OK) {
    for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      thrusts[rotor] = wanted[rotor];
    }
  }
  return result;
}

/* Whether the policy flies this tick: it has answered, or did so just now. */
static bool flies(const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state, uint32_t step) {
  if (!flying || step % period == 0) {
    if (!flying) {
      kestrel_reset(&pilot);
      heading = state->attitude.yaw;
    }
    answer = act(setpoint, sensors, state);
  }
  held = answer == KESTREL_OK ? 0 : held + 1;
  return answer == KESTREL_OK || (flying && held <= HOLD_TICKS);
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep) {
  /* Runs along, so that it can take over in any tick. */
  controllerPid(control, setpoint, sensors, state, stabilizerStep);
  flying = enable && refusal == KESTREL_OK && is_fresh_position(setpoint) && flies(setpoint, sensors, state, stabilizerStep);
  if (!flying) {
    return;
  }
  control->controlMode = controlModeForce;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    const float share = SHARE_OF_QUARTER_WEIGHT * thrusts[rotor];
    control->normalizedForces[rotor] = share < 1.0f ? share : 1.0f;
  }
}

PARAM_GROUP_START(kestrel)
/* 0: the PID controller flies */
PARAM_ADD(PARAM_UINT8, enable, &enable)
PARAM_GROUP_STOP(kestrel)

LOG_GROUP_START(kestrel)
LOG_ADD(LOG_INT32, answer, &answer)
LOG_ADD(LOG_UINT8, flying, &flying)
LOG_ADD(LOG_UINT32, held, &held)
LOG_ADD(LOG_FLOAT, m1, &thrusts[0])
LOG_ADD(LOG_FLOAT, m2, &thrusts[1])
LOG_ADD(LOG_FLOAT, m3, &thrusts[2])
LOG_ADD(LOG_FLOAT, m4, &thrusts[3])
LOG_GROUP_STOP(kestrel)
