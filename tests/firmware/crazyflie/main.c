/* Flies the app for a while, as the stabilizer of crazyflie-firmware would, and prints a digest of what the motors got; then
 * damages the policy. The output must be the same on every machine. */
#include <stdio.h>
#include <string.h>

#include "controller.h"
#include "controller_pid.h"
#include "kestrel.h"
#include "policy.h"
#include "task.h"

#define TICKS 20000

static uint32_t random_state = 1;
static int pid_ticks;

/* A task runs at once, on the stack of who creates it. */
void vTaskDelay(uint32_t ticks) { (void)ticks; }
void vTaskDelete(TaskHandle_t task) { (void)task; }
UBaseType_t uxTaskPriorityGet(TaskHandle_t task) { return task == NULL; }
TaskHandle_t xTaskCreateStatic(TaskFunction_t code, const char *name, uint32_t stack_words, void *argument,
                               UBaseType_t priority, StackType_t *stack, StaticTask_t *task) {
  (void)name, (void)stack_words, (void)priority, (void)stack;
  code(argument);
  return task;
}
void controllerPidInit(void) {}
bool controllerPidTest(void) { return true; }

void controllerPid(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state,
                   const stabilizerStep_t stabilizerStep) {
  (void)setpoint, (void)sensors, (void)state, (void)stabilizerStep;
  pid_ticks++;
  memset(control, 0, sizeof *control);
  control->controlMode = controlModeLegacy;
}

/* In [-1, 1): the high bits of Knuth's generator. */
static float uniform(void) {
  random_state = random_state * 1664525u + 1013904223u;
  return (float)(int32_t)(random_state >> 8) / 8388608.0f - 1.0f;
}

static uint64_t digest = 0xcbf29ce484222325u;

static void add(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  for (int byte = 0; byte < 4; byte++) {
    digest = (digest ^ (bits >> (8 * byte) & 0xff)) * 0x100000001b3u;
  }
}

static void fly(void) {
  int policy_ticks = 0;
  for (uint32_t tick = 0; tick < TICKS; tick++) {
    const sensorData_t sensors = {.gyro = {30.0f * uniform(), 30.0f * uniform(), 30.0f * uniform()}};
    const state_t state = {
        .attitudeQuaternion = {0.1f * uniform(), 0.1f * uniform(), 0.1f * uniform(), 0.98f},
        .position = {uniform(), uniform(), tick % 5000 == 4000 ? 0.0f / (float)random_state * 1e38f : 1.0f + uniform()},
        .velocity = {uniform(), uniform(), uniform()},
    };
    setpoint_t setpoint = {.position = {0.2f, -0.1f, 1.0f}};
    setpoint.mode.x = setpoint.mode.y = setpoint.mode.z = tick % 3000 < 2500 ? modeAbs : modeVelocity;
    control_t control;
    controllerOutOfTree(&control, &setpoint, &sensors, &state, tick);
    policy_ticks += control.controlMode == controlModeForce;
    for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      add(control.normalizedForces[rotor]);
    }
  }
  printf("%d ticks, %d of the policy, %d of the PID alone: %08lx%08lx\n", TICKS, policy_ticks, TICKS - policy_ticks,
         (unsigned long)(digest >> 32), (unsigned long)(digest & 0xffffffffu));
}

/* Every bit of a policy is under its checksum. */
static void damage(void) {
  static uint8_t copy[65536] __attribute__((aligned(8)));
  static KestrelPilot pilot;
  if (kestrel_policy_len > sizeof copy) {
    printf("the policy is too long\n");
    return;
  }
  int refused = 0, tried = 0;
  for (size_t bit = 0; bit < 8 * kestrel_policy_len; bit += 97, tried++) {
    memcpy(copy, kestrel_policy, kestrel_policy_len);
    copy[bit / 8] ^= (uint8_t)(1u << (bit % 8));
    refused += kestrel_take_policy(&pilot, copy, kestrel_policy_len) != KESTREL_OK;
  }
  printf("%d bits altered, %d refused\n", tried, refused);
  memcpy(copy, kestrel_policy, kestrel_policy_len);
  const size_t lengths[] = {0, 7, 100, kestrel_policy_len - 1};
  for (size_t index = 0; index < sizeof lengths / sizeof *lengths; index++) {
    printf("truncated: %d\n", (int)kestrel_take_policy(&pilot, copy, lengths[index]));
  }
  printf("oversized: %d\n", (int)kestrel_take_policy(&pilot, copy, kestrel_policy_len + 4));
  copy[8] = 200;
  printf("of a later version: %d\n", (int)kestrel_take_policy(&pilot, copy, kestrel_policy_len));
  const KestrelState state = {.attitude = {1.0f}};
  const float goal[3] = {0.0f};
  float thrusts[4] = {1.0f, 1.0f, 1.0f, 1.0f};
  const int32_t answer = kestrel_tick(&pilot, &state, &goal, &thrusts);
  printf("then a tick: %d, thrust %d\n", (int)answer, (int)thrusts[0]);
}

int main(void) {
  controllerOutOfTreeInit();
  printf("the controller's test: %d\n", controllerOutOfTreeTest());
  fly();
  damage();
  return 0;
}
