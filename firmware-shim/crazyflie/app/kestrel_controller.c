/* A policy of Kestrel as the out-of-tree controller of crazyflie-firmware.
 *
 * The policy flies while the set-point is a position; everything else, and whatever the policy cannot fly, is left to the
 * firmware's own PID controller. A policy that does not compute here what it did where it was exported is refused, and
 * the Crazyflie does not arm.
 */
#include <stdbool.h>
#include <stdint.h>

#include "app.h"

#include "FreeRTOS.h"
#include "task.h"

#include "controller.h"
#include "controller_pid.h"

#define DEBUG_MODULE "KESTREL"
#include "debug.h"

#include "kestrel.h"
#include "policy.h"

#define RADIANS_PER_DEGREE 0.017453292519943295f

static KestrelPilot pilot;
static int32_t refusal = KESTREL_NO_POLICY;

/* Reading a policy takes 6 KB of stack, once; the task that starts the system has 1.2. */
#define READING_STACK_WORDS 2048
static StackType_t reading_stack[READING_STACK_WORDS];
static StaticTask_t reading_task;
static volatile bool has_read;

/* Ticks of the stabilizer from one action to the next. */
static uint32_t period = 1;

/* Of the last action. */
static float thrusts[4];
static int32_t answer = KESTREL_NO_POLICY;

/* Whether the policy flew at the last tick. */
static bool flying;

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
  flying = false;
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

bool controllerOutOfTreeTest(void) {
  if (refusal != KESTREL_OK) {
    DEBUG_PRINT("policy refused: %d\n", (int)refusal);
  }
  return refusal == KESTREL_OK && controllerPidTest();
}

static bool is_position(const setpoint_t *setpoint) {
  return setpoint->mode.x == modeAbs && setpoint->mode.y == modeAbs && setpoint->mode.z == modeAbs;
}

static int32_t act(const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state) {
  const float goal[3] = {setpoint->position.x, setpoint->position.y, setpoint->position.z};
  const KestrelState here = {
      .position = {state->position.x, state->position.y, state->position.z},
      .attitude = {state->attitudeQuaternion.w, state->attitudeQuaternion.x, state->attitudeQuaternion.y,
                   state->attitudeQuaternion.z},
      .velocity = {state->velocity.x, state->velocity.y, state->velocity.z},
      .body_rates = {RADIANS_PER_DEGREE * sensors->gyro.x, RADIANS_PER_DEGREE * sensors->gyro.y,
                     RADIANS_PER_DEGREE * sensors->gyro.z},
  };
  return kestrel_tick(&pilot, &here, &goal, &thrusts);
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep) {
  /* Runs along, so that it can take over in any tick. */
  controllerPid(control, setpoint, sensors, state, stabilizerStep);
  if (refusal != KESTREL_OK || !is_position(setpoint)) {
    flying = false;
    return;
  }
  if (!flying || stabilizerStep % period == 0) {
    if (!flying) {
      kestrel_reset(&pilot);
    }
    flying = true;
    answer = act(setpoint, sensors, state);
  }
  if (answer != KESTREL_OK) {
    return;
  }
  control->controlMode = controlModeForce;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    control->normalizedForces[rotor] = thrusts[rotor];
  }
}
