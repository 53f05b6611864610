/* A policy of Kestrel as the out-of-tree controller of crazyflie-firmware.
 *
 * The policy flies while the set-point is a fresh position; everything else, and whatever the policy cannot fly, is left to
 * the firmware's own PID controller. A policy that does not compute here what it did where it was exported is refused, and
 * the Crazyflie does not arm.
 *
 * Parameters (group kestrel): `enable`, 0 leaves everything to the PID controller; `pwm`, 1 if the firmware takes duty cycles
 * for its normalized forces, and then `fullThrust` (N of a motor at full throttle and a full battery; 0 for what the policy was
 * trained with) and `fullVoltage` (V of that battery); with a policy that sees a scan `room`, the number of the room in
 * policy.h in which the drone is: its beams are cast in the map of that room, from the estimated position; `compRotors`, 1
 * learns in flight what share of its thrust each rotor really makes and drives weak ones harder, 0 forgets it. Logs: `answer` (why
 * the policy does not fly, 0 if it does), `flying`, `held` (microseconds for which the last thrusts were held), `m1` ... `m4`
 * (thrust in quarters of the weight), `s1` ... `s4` (the shares that were learned).
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "app.h"

#include "FreeRTOS.h"
#include "task.h"

#include "controller.h"
#include "controller_pid.h"
#include "log.h"
#include "param.h"
#include "pm.h"
#include "platform_defaults.h"

#define DEBUG_MODULE "KESTREL"
#include "debug.h"

#include "kestrel.h"
#include "kestrel_guard.h"
#include "policy.h"

#define RADIANS_PER_DEGREE 0.017453292519943295f
#define GRAVITY 9.81f /* m/s^2 */

/* A quarter of the drone's weight, as this firmware has it [N]. */
#define QUARTER_WEIGHT (0.25f * CF_MASS * GRAVITY)

/* A firmware that compensates the battery makes thrust of shares. Another makes duty cycles of them. */
#ifdef CONFIG_ENABLE_THRUST_BAT_COMPENSATED
#define PWM 0
#else
#define PWM 1
#endif

/* Below, the measurement of the battery's voltage is broken, or there is no battery [V]. */
#define LEAST_VOLTAGE 2.0f

#define US_PER_MS 1000u

/* While a state is refused, the last thrusts are held for 10 ms before the PID controller takes over: one lost sample is
 * forgiven, and that is less than an attitude loop needs. A set-point that is older than a second is no order any more: the
 * firmware levels the drone after half a second without one, and stops the motors after two. */
static KestrelGuard guard = {.hold_us = 10u * US_PER_MS, .stale_us = 1000u * US_PER_MS};

/* What the policy sees beside the drone's motion: rangers first, then the beams of a scan. */
#ifndef KESTREL_RANGERS
#define KESTREL_RANGERS 0
#endif
#ifndef KESTREL_ROOMS
#define KESTREL_ROOMS 0
#endif
#ifndef KESTREL_MEASUREMENTS
#define KESTREL_MEASUREMENTS 0
static const float *const measurements = NULL;
#else
static float measurements[KESTREL_MEASUREMENTS];
#endif

#if KESTREL_RANGERS > 0
#define MILLIMETRE 0.001f
static char *const ranger_names[KESTREL_RANGERS] = {KESTREL_RANGER_NAMES};
static const float ranger_limits[KESTREL_RANGERS] = {KESTREL_RANGER_LIMITS};
static logVarId_t rangers[KESTREL_RANGERS];
#endif

#if KESTREL_ROOMS > 0
static uint8_t room;
#endif

static KestrelPilot pilot;
static int32_t refusal = KESTREL_NO_POLICY;

/* Reading a policy takes 2.7 KB of stack, once, one with a memory 4.7; the task that starts the system has 1.2. */
#ifdef KESTREL_RECURRENT
#define READING_STACK_WORDS 1300
#else
#define READING_STACK_WORDS 780
#endif
static StackType_t reading_stack[READING_STACK_WORDS];
static StaticTask_t reading_task;
static volatile bool has_read;

/* Ticks of the stabilizer from one action to the next. */
static uint32_t period = 1;

/* Of the last action that the policy answered. */
static float thrusts[4];
static int32_t answer = KESTREL_NO_POLICY;

/* Whether the policy flew at the last tick. */
static uint8_t flying;

/* Where the nose shall point: deg, as the set-points have it, counter-clockwise. */
static float heading;

static uint8_t enable = 1;
static uint8_t pwm = PWM;
static float full_thrust;
static float full_voltage = 4.2f;
static uint8_t compensates_rotors;

/* Of their thrust, that the rotors make. */
static float shares[4] = {1.0f, 1.0f, 1.0f, 1.0f};

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
  guard.flies = 0;
  if (has_read) {
    return;
  }
  xTaskCreateStatic(read_policy, "KESTREL", READING_STACK_WORDS, NULL, uxTaskPriorityGet(NULL), reading_stack, &reading_task);
  while (!has_read) {
    vTaskDelay(1);
  }
#if KESTREL_RANGERS > 0
  for (int ranger = 0; ranger < KESTREL_RANGERS; ranger++) {
    rangers[ranger] = logGetVarId("range", ranger_names[ranger]);
  }
#endif
  period = (uint32_t)(kestrel_control_period(&pilot) * RATE_MAIN_LOOP + 0.5f);
  if (period == 0) {
    period = 1;
  }
}

/* Thrust of a motor at full throttle and a full battery [N]. */
static float greatest_thrust(void) {
  if (!pwm) {
    return THRUST_MAX;
  }
  return full_thrust > 0.0f ? full_thrust : QUARTER_WEIGHT * kestrel_greatest_thrust(&pilot);
}

/* What a firmware of another drone would get wrong is said before it arms. */
static bool can_carry(void) {
  const int percent_here = (int)(100.0f * greatest_thrust() / QUARTER_WEIGHT);
  const int percent_trained = (int)(100.0f * kestrel_greatest_thrust(&pilot));
  DEBUG_PRINT("%d g, %d mN a motor%s: thrust %d %% of the weight, trained with %d %%\n", (int)(1000.0f * CF_MASS + 0.5f),
              (int)(1000.0f * greatest_thrust() + 0.5f), pwm ? " by PWM" : "", percent_here, percent_trained);
  return percent_here > 110;
}

/* Duty cycle for a share of the greatest thrust: a rotor turns in proportion to the voltage of its motor, and its thrust grows
 * with the square of that. */
static float duty_of(float share) {
  const float voltage = pmGetBatteryVoltage();
  const float duty = sqrtf(share) * (voltage > LEAST_VOLTAGE ? full_voltage / voltage : 1.0f);
  return duty < 1.0f ? duty : 1.0f;
}

/* Share of the greatest thrust below which no rotor is slowed down for others: a stopped one comes back late. */
#define IDLE 0.02f

/* What the firmware calls normalized forces: shares of the greatest thrust, or duty cycles. A policy may have been trained with
 * stronger motors. What is missing is taken from all rotors alike, so that the drone sinks and does not tip over. */
static void command(control_t *control) {
  const float limit = greatest_thrust() / QUARTER_WEIGHT;
  float excess = 0.0f;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    const float beyond = thrusts[rotor] - limit;
    excess = beyond > excess ? beyond : excess;
  }
  control->controlMode = controlModeForce;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    const float left = thrusts[rotor] - excess;
    const float least = thrusts[rotor] < IDLE * limit ? thrusts[rotor] : IDLE * limit;
    const float share = (left > least ? left : least) / limit;
    control->normalizedForces[rotor] = pwm ? duty_of(share) : share;
  }
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

static bool is_position(const setpoint_t *setpoint) {
  return setpoint->mode.x == modeAbs && setpoint->mode.y == modeAbs && setpoint->mode.z == modeAbs;
}

/* Age of a set-point in microseconds; four seconds and more are four. */
static uint32_t age_of(const setpoint_t *setpoint) {
  const uint32_t age_ms = T2M(xTaskGetTickCount() - setpoint->timestamp);
  return US_PER_MS * (age_ms < 4000u ? age_ms : 4000u);
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

/* Whether there is a measurement of everything that the policy sees: a ranger that has not measured, or that is not there, reads
 * zero. */
static bool measure(const float (*position)[3]) {
#if KESTREL_RANGERS > 0
  for (int ranger = 0; ranger < KESTREL_RANGERS; ranger++) {
    const unsigned int distance = LOG_VARID_IS_VALID(rangers[ranger]) ? logGetUint(rangers[ranger]) : 0u;
    if (distance == 0u) {
      return false;
    }
    const float metres = MILLIMETRE * (float)distance;
    measurements[ranger] = metres < ranger_limits[ranger] ? metres : ranger_limits[ranger];
  }
#endif
#if KESTREL_ROOMS > 0
  if (room >= KESTREL_ROOMS) {
    return false;
  }
  kestrel_scan(&kestrel_rooms[room], position, measurements + KESTREL_RANGERS);
#else
  (void)position;
#endif
  return true;
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
  if (!measure(&here.position)) {
    return KESTREL_UNMEASURED;
  }
  (void)kestrel_compensate_rotors(&pilot, compensates_rotors != 0);
  kestrel_rotor_shares(&pilot, &shares);
  const int32_t result = kestrel_tick_measured(&pilot, &here, &goal, measurements, KESTREL_MEASUREMENTS, &wanted);
  if (result == KESTREL_OK) {
    for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      thrusts[rotor] = wanted[rotor];
    }
  }
  return result;
}

/* Whether the policy flies this tick: it has answered, or did so just now. */
static bool flies(const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state, uint32_t step) {
  if (!guard.flies || step % period == 0) {
    if (!guard.flies) {
      kestrel_reset(&pilot);
      heading = state->attitude.yaw;
    }
    answer = act(setpoint, sensors, state);
  } else if (answer == KESTREL_OK) {
    /* What a policy with a rate loop does at every sample of the gyroscope; others hold. */
    const float rates[3] = {RADIANS_PER_DEGREE * sensors->gyro.x, RADIANS_PER_DEGREE * sensors->gyro.y,
                            RADIANS_PER_DEGREE * sensors->gyro.z};
    (void)kestrel_follow_rates(&pilot, &rates, &thrusts);
  }
  return kestrel_guard(&guard, answer, age_of(setpoint), US_PER_MS) != KESTREL_HAND_OVER;
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep) {
  /* Runs along, so that it can take over in any tick. */
  controllerPid(control, setpoint, sensors, state, stabilizerStep);
  flying = enable && refusal == KESTREL_OK && is_position(setpoint) && flies(setpoint, sensors, state, stabilizerStep);
  if (!flying) {
    guard.flies = 0;
    return;
  }
  command(control);
}

PARAM_GROUP_START(kestrel)
/* 0: the PID controller flies */
PARAM_ADD(PARAM_UINT8, enable, &enable)
/* 1: normalized forces are duty cycles, as in a firmware that does not compensate its battery */
PARAM_ADD(PARAM_UINT8, pwm, &pwm)
/* 1: weak rotors are found in flight, and driven harder; 0: not, and what was learned is forgotten */
PARAM_ADD(PARAM_UINT8, compRotors, &compensates_rotors)
/* Thrust of a motor at full throttle and a full battery [N]; 0: what the policy was trained with */
PARAM_ADD(PARAM_FLOAT, fullThrust, &full_thrust)
/* Voltage of a full battery [V] */
PARAM_ADD(PARAM_FLOAT, fullVoltage, &full_voltage)
#if KESTREL_ROOMS > 0
/* Which of the rooms of policy.h the drone is in */
PARAM_ADD(PARAM_UINT8, room, &room)
#endif
PARAM_GROUP_STOP(kestrel)

LOG_GROUP_START(kestrel)
LOG_ADD(LOG_INT32, answer, &guard.code)
LOG_ADD(LOG_UINT8, flying, &flying)
LOG_ADD(LOG_UINT32, held, &guard.refused_us)
LOG_ADD(LOG_FLOAT, m1, &thrusts[0])
LOG_ADD(LOG_FLOAT, m2, &thrusts[1])
LOG_ADD(LOG_FLOAT, m3, &thrusts[2])
LOG_ADD(LOG_FLOAT, m4, &thrusts[3])
LOG_ADD(LOG_FLOAT, s1, &shares[0])
LOG_ADD(LOG_FLOAT, s2, &shares[1])
LOG_ADD(LOG_FLOAT, s3, &shares[2])
LOG_ADD(LOG_FLOAT, s4, &shares[3])
LOG_GROUP_STOP(kestrel)
