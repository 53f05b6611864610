/* The app for crazyflie-firmware as its stabilizer calls it: degrees per second of the gyroscope, degrees of the set-points,
 * millimetres of the rangers, shares of the greatest thrust for the motors, a thousand times a second. A policy that sees a scan
 * flies in the room whose number is in the environment, ROOM: the app casts the beams itself. With COMPENSATES in the environment
 * it learns what the rotors lack. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "adapter.h"
#include "controller.h"
#include "kestrel.h"
#include "log.h"
#include "platform_defaults.h"
#include "policy.h"
#include "stubs.h"

/* Another policy than the one that was compiled in, and a tick that the PID controller flew. */
#define OTHER_POLICY 110
#define PID_FLIES 111

#define DEGREES_PER_RADIAN 57.29577951308232f

/* Rotor speed (rad/s) at which the airframe crazyflie_2_1 hovers: of 27 g, 9.8 m/s^2 and 2.8815e-8 N s^2. */
#define HOVER_SPEED 1515.13f

/* Ticks of the stabilizer in a control period of the policy. */
static uint32_t ticks;
static stabilizerStep_t step;

extern const void *const log_answer;

float pmGetBatteryVoltage(void);
float pmGetBatteryVoltage(void) { return 4.2f; }

#ifdef KESTREL_RANGERS
static char *const ranger_names[] = {KESTREL_RANGER_NAMES};
static unsigned int millimetres[KESTREL_RANGERS];

logVarId_t logGetVarId(char *group, char *name) {
  for (logVarId_t id = 0; strcmp(group, "range") == 0 && id < KESTREL_RANGERS; id++) {
    if (strcmp(name, ranger_names[id]) == 0) return id;
  }
  return 0xffff;
}

unsigned int logGetUint(logVarId_t id) { return millimetres[id]; }
#endif

#ifdef KESTREL_ROOMS
extern void *const param_room;
#endif
extern void *const param_compRotors;

int32_t adapter_take(const uint8_t *policy, size_t len) {
  static KestrelPilot pilot;
  if (len != kestrel_policy_len || memcmp(policy, kestrel_policy, len) != 0) {
    return OTHER_POLICY;
  }
  const int32_t refusal = kestrel_take_policy(&pilot, kestrel_policy, kestrel_policy_len);
  ticks = (uint32_t)(kestrel_control_period(&pilot) * RATE_MAIN_LOOP + 0.5f);
#ifdef KESTREL_ROOMS
  const char *room = getenv("ROOM");
  *(uint8_t *)param_room = (uint8_t)(room != NULL ? atoi(room) : 0);
#endif
  *(uint8_t *)param_compRotors = getenv("COMPENSATES") != NULL;
  controllerOutOfTreeInit();
  return refusal != 0 ? refusal : controllerOutOfTreeTest() ? 0 : PID_FLIES;
}

/* A set-point that is no position lets the policy forget what it did. */
void adapter_reset(void) {
  const sensorData_t sensors = {.gyro = {0.0f, 0.0f, 0.0f}};
  const state_t state = {.attitudeQuaternion = {0.0f, 0.0f, 0.0f, 1.0f}};
  const setpoint_t setpoint = {.timestamp = now};
  control_t control;
  controllerOutOfTree(&control, &setpoint, &sensors, &state, step);
  step = 0;
}

/* The firmware's thrust for a drone of its own mass, on the simulated one: as many weights. */
static float speed_of(float share) {
  const float quarter_weights = share * THRUST_MAX / (0.25f * CF_MASS * 9.81f);
  return HOVER_SPEED * sqrtf(quarter_weights > 0.0f ? quarter_weights : 0.0f);
}

int32_t adapter_tick(const AdapterTick *tick, const float *measurements, size_t count, float speeds[4]) {
#ifdef KESTREL_RANGERS
  for (size_t ranger = 0; ranger < KESTREL_RANGERS && ranger < count; ranger++) {
    millimetres[ranger] = (unsigned int)(1000.0f * measurements[ranger] + 0.5f);
  }
#else
  (void)measurements, (void)count;
#endif
  const float *position = tick->position, *velocity = tick->velocity, *rates = tick->body_rates, *q = tick->attitude;
  const float degrees = DEGREES_PER_RADIAN;
  const sensorData_t sensors = {.gyro = {degrees * rates[0], degrees * rates[1], degrees * rates[2]}};
  const state_t state = {
      .attitude.yaw = degrees * atan2f(2.0f * (q[0] * q[3] + q[1] * q[2]), 1.0f - 2.0f * (q[2] * q[2] + q[3] * q[3])),
      .attitudeQuaternion = {.w = q[0], .x = q[1], .y = q[2], .z = q[3]},
      .position = {position[0], position[1], position[2]},
      .velocity = {velocity[0], velocity[1], velocity[2]},
  };
  setpoint_t setpoint = {.attitude.yaw = degrees * tick->heading, .position = {tick->goal[0], tick->goal[1], tick->goal[2]}};
  setpoint.mode.x = setpoint.mode.y = setpoint.mode.z = setpoint.mode.yaw = modeAbs;
  control_t control;
  for (uint32_t tick_of_period = 0; tick_of_period < ticks; tick_of_period++) {
    setpoint.timestamp = now;
    controllerOutOfTree(&control, &setpoint, &sensors, &state, step++);
    now++;
    if (control.controlMode != controlModeForce) {
      const int32_t answer = *(const int32_t *)log_answer;
      return answer != 0 ? answer : PID_FLIES;
    }
  }
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    speeds[rotor] = speed_of(control.normalizedForces[rotor]);
  }
  return 0;
}
