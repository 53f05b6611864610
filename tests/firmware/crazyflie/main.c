/* Flies the app for a while, as the stabilizer of crazyflie-firmware would, and prints a digest of what the motors got; then
 * breaks single states, lets a set-point grow old, and damages the policy. The output must be the same on every machine. */
#include <stdio.h>
#include <string.h>

#include "controller.h"
#include "kestrel.h"
#include "platform_defaults.h"
#include "pm.h"
#include "policy.h"

#define TICKS 20000
#define SPECIAL_STATES 12000

static uint32_t random_state = 1;

extern const void *const log_answer, *const log_m1, *const log_m2, *const log_m3, *const log_m4;
extern const void *const log_s1, *const log_s2, *const log_s3, *const log_s4;
extern void *const param_enable, *const param_fullThrust, *const param_fullVoltage, *const param_pwm, *const param_compRotors;

#include "FreeRTOS.h"
#include "task.h"

#ifdef __arm__
#define DEPTH_WORDS 2048
#define PAINT 0xa5a5a5a5u

/* Bytes of stack that a task takes: words below the stack pointer lose their paint. */
static uint32_t stack_of(TaskFunction_t code, void *argument) {
  uint32_t *top, *word;
  __asm__ volatile("mov %0, sp" : "=r"(top));
  for (word = top - DEPTH_WORDS; word < top - 8; word++) *word = PAINT;
  code(argument);
  for (word = top - DEPTH_WORDS; word < top && *word == PAINT;) word++;
  return 4 * (uint32_t)(top - word);
}
#else
static uint32_t stack_of(TaskFunction_t code, void *argument) {
  code(argument);
  return 0;
}
#endif

/* FreeRTOS keeps the registers of a task on its stack, those of the floating-point unit too. */
#define CONTEXT_BYTES 204

/* A task that takes more stack than it has is said. */
static void run_task(TaskFunction_t code, void *argument, uint32_t stack_words) {
  const uint32_t taken = stack_of(code, argument), given = 4 * stack_words;
  if (taken + CONTEXT_BYTES > given) {
    printf("the stack overflows: %lu of %lu bytes\n", (unsigned long)taken, (unsigned long)given);
  }
}

#define RUN_TASK run_task
#include "stubs.h"

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

#define FULL_THRUST 0.15f /* N of a motor at full throttle and a full battery, without compensation */
#define FULL_VOLTAGE 4.2f
static float voltage = 3.6f;

float pmGetBatteryVoltage(void) { return voltage; }

/* Of a motor with a full battery [N]. */
#ifdef CONFIG_ENABLE_THRUST_BAT_COMPENSATED
#define GREATEST THRUST_MAX
#else
#define GREATEST FULL_THRUST
#endif

/* Thrust of a motor [N] that is commanded so: with compensation a share of the greatest, without a duty cycle. */
static float thrust_of(float command) {
#ifdef CONFIG_ENABLE_THRUST_BAT_COMPENSATED
  return command * THRUST_MAX;
#else
  const float share = command * voltage / FULL_VOLTAGE;
  return FULL_THRUST * share * share;
#endif
}

/* Whether the motors get what the policy asked for, in shares of the weight: a rotor that shall carry a quarter of the weight gets
 * the thrust that this firmware's own constants say, less what one of them cannot give, but a fiftieth of the greatest at least. */
static bool carries(const control_t *control) {
  const float quarter_weight = CF_MASS * 9.81f / 4.0f;
  const float greatest = GREATEST;
  const void *const asked[] = {log_m1, log_m2, log_m3, log_m4};
  float excess = 0.0f;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    const float beyond = *(const float *)asked[rotor] * quarter_weight - greatest;
    excess = beyond > excess ? beyond : excess;
  }
  bool all = true;
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    const float thrust = *(const float *)asked[rotor] * quarter_weight, left = thrust - excess;
    const float least = thrust < 0.02f * greatest ? thrust : 0.02f * greatest;
    const float most = thrust_of(1.0f), wanted = left < least ? least : left < most ? left : most;
    const float error = thrust_of(control->normalizedForces[rotor]) - wanted;
    all = all && error < 1e-4f * greatest && error > -1e-4f * greatest;
  }
  return all;
}

/* One tick at a quiet place, as far as `sensors` and `setpoint` say nothing else; whether the policy flew. */
static bool tick(const sensorData_t *sensors, const setpoint_t *setpoint, control_t *control) {
  const state_t state = {.attitudeQuaternion = {0.0f, 0.0f, 0.0f, 1.0f}, .position = {0.1f, 0.0f, 1.0f}};
  now++;
  controllerOutOfTree(control, setpoint, sensors, &state, now);
  return control->controlMode == controlModeForce;
}

static setpoint_t position_at(uint32_t timestamp) {
  setpoint_t setpoint = {.timestamp = timestamp, .position = {0.1f, 0.0f, 1.0f}};
  setpoint.mode.x = setpoint.mode.y = setpoint.mode.z = modeAbs;
  return setpoint;
}

static void fly(void) {
  int policy_ticks = 0, carried = 0;
  for (uint32_t step = 0; step < TICKS; step++, now++) {
    const sensorData_t sensors = {.gyro = {30.0f * uniform(), 30.0f * uniform(), 30.0f * uniform()}};
    const state_t state = {
        .attitudeQuaternion = {0.1f * uniform(), 0.1f * uniform(), 0.1f * uniform(), 0.98f},
        .position = {uniform(), uniform(), step % 5000 == 4000 ? 0.0f / (float)random_state * 1e38f : 1.0f + uniform()},
        .velocity = {uniform(), uniform(), uniform()},
    };
    setpoint_t setpoint = position_at(now);
    setpoint.mode.x = setpoint.mode.y = setpoint.mode.z = step % 3000 < 2500 ? modeAbs : modeVelocity;
    control_t control;
    controllerOutOfTree(&control, &setpoint, &sensors, &state, step);
    if (control.controlMode == controlModeForce) {
      policy_ticks++;
      carried += carries(&control);
    }
    for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      add(control.normalizedForces[rotor]);
    }
  }
  printf("%d ticks, %d of the policy, %d of the PID alone, right thrust in %d: %08lx%08lx\n", TICKS, policy_ticks,
         TICKS - policy_ticks, carried, (unsigned long)(digest >> 32), (unsigned long)(digest & 0xffffffffu));
}

/* A rate that is not finite for a tick stops no rotor; for longer, the PID controller takes over, and gives back. */
static void lose_a_sensor(void) {
  const uint32_t not_a_number = 0x7fc00000;
  sensorData_t quiet = {.gyro = {0.0f, 0.0f, 0.0f}}, broken = quiet;
  memcpy(&broken.gyro.x, &not_a_number, sizeof not_a_number);
  control_t control;
  int flown = 0, stopped = 0, answers = 0;
  for (int step = 0; step < 100; step++) {
    const setpoint_t setpoint = position_at(now);
    const bool lost = step == 20 || step >= 50;
    const bool policy = tick(lost && step < 90 ? &broken : &quiet, &setpoint, &control);
    flown += policy;
    answers += *(const int32_t *)log_answer == KESTREL_BODY_RATES;
    for (int rotor = 0; policy && rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      stopped += !(control.normalizedForces[rotor] > 0.01f);
    }
  }
  printf("of 100 ticks, 41 without a rate: %d of the policy, %d rotors stopped, %d refused states\n", flown, stopped, answers);
}

static void wait_for_orders(void) {
  const sensorData_t quiet = {.gyro = {0.0f, 0.0f, 0.0f}};
  const setpoint_t setpoint = position_at(now);
  control_t control;
  int flown = 0;
  for (int step = 0; step < 2000; step++) flown += tick(&quiet, &setpoint, &control);
  printf("a set-point is flown to for %d ms\n", flown);
  *(uint8_t *)param_enable = 0;
  const setpoint_t next = position_at(now);
  printf("switched off, the policy flies: %d\n", tick(&quiet, &next, &control));
}

/* Not a number (quiet, signalling), infinite, subnormal, zero, huge, or about as large as the limits. */
static float special(void) {
  random_state = random_state * 1664525u + 1013904223u;
  const uint32_t noise = random_state;
  random_state = random_state * 1664525u + 1013904223u;
  const uint32_t bits = (noise & 0xffff0000u) | random_state >> 16;
  const uint32_t kinds[] = {
      (bits & 0x803fffffu) | 0x7fc00000u, (bits & 0x803fffffu) | 0x7f800001u, (bits & 0x80000000u) | 0x7f800000u,
      bits & 0x807fffffu, bits & 0x80000000u, (bits & 0x80ffffffu) | 0x7e000000u, (bits & 0x83ffffffu) | 0x40000000u,
  };
  float value;
  memcpy(&value, &kinds[(noise >> 8) % 7], sizeof value);
  return value;
}

/* Ticks of a level drone at its goal that sinks faster and faster, as if its rotors made less than they should. */
static void sink(int ticks) {
  const sensorData_t quiet = {.gyro = {0.0f, 0.0f, 0.0f}};
  control_t control;
  for (int step = 0; step < ticks; step++) {
    const setpoint_t setpoint = position_at(now++);
    const state_t state = {
        .attitudeQuaternion = {0.0f, 0.0f, 0.0f, 1.0f},
        .position = {0.1f, 0.0f, 1.0f},
        .velocity = {0.0f, 0.0f, -0.0005f * (float)step},
    };
    controllerOutOfTree(&control, &setpoint, &quiet, &state, now);
  }
}

static void print_shares(const char *when) {
  const void *const shares[] = {log_s1, log_s2, log_s3, log_s4};
  printf("shares of thrust %s:", when);
  for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
    printf(" %d", (int)(1000.0f * *(const float *)shares[rotor] + 0.5f));
  }
  printf(" per mille\n");
}

/* What the rotors lack is learned once it is asked for, kept while the PID controller flies, and forgotten when it is switched off. */
static void weaken(void) {
  *(uint8_t *)param_enable = 1;
  sink(1000);
  print_shares("unasked");
  *(uint8_t *)param_compRotors = 1;
  sink(1000);
  print_shares("of a drone that sinks");
  *(uint8_t *)param_enable = 0;
  sink(100);
  *(uint8_t *)param_enable = 1;
  sink(1);
  print_shares("behind the PID controller");
  *(uint8_t *)param_compRotors = 0;
  sink(100);
  print_shares("switched off");
}

/* In every second tick one number of the state is special: the tick is refused with a code, or flown; no rotor stops. Rotors are
 * learned meanwhile. */
static void meet_special_values(void) {
  control_t control;
  int refused = 0, stopped = 0, flown = 0;
  *(uint8_t *)param_enable = *(uint8_t *)param_compRotors = 1;
  for (int input = 0; input < 2 * SPECIAL_STATES; input++) {
    float v[13] = {0.1f, 0.0f, 1.0f, 1.0f, 0.0f, 0.0f, 0.0f};
    if (input % 2 == 1) {
      v[input % 13] = special();
    }
    const setpoint_t setpoint = position_at(now++);
    const sensorData_t sensors = {.gyro = {v[10], v[11], v[12]}};
    const state_t state = {
        .attitudeQuaternion = {.w = v[3], .x = v[4], .y = v[5], .z = v[6]},
        .position = {v[0], v[1], v[2]},
        .velocity = {v[7], v[8], v[9]},
    };
    controllerOutOfTree(&control, &setpoint, &sensors, &state, 0);
    const bool policy = control.controlMode == controlModeForce;
    const int32_t answer = *(const int32_t *)log_answer;
    refused += answer != KESTREL_OK;
    flown += policy;
    digest = (digest ^ (uint32_t)answer) * 0x100000001b3u;
    for (int rotor = 0; rotor < STABILIZER_NR_OF_MOTORS; rotor++) {
      add(control.normalizedForces[rotor]);
      /* A rotor may stop because the policy wants it to in a state that it accepts. */
      stopped += answer != KESTREL_OK && policy && !(control.normalizedForces[rotor] > 0.01f);
    }
  }
  printf("of %d special states %d refused, %d flown or held, in which %d rotors stopped: %08lx%08lx\n", SPECIAL_STATES,
         refused, flown, stopped, (unsigned long)(digest >> 32), (unsigned long)(digest & 0xffffffffu));
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
  const float goal[4] = {0.0f};
  float thrusts[4] = {1.0f, 1.0f, 1.0f, 1.0f};
  const int32_t answer = kestrel_tick_measured(&pilot, &state, &goal, NULL, 0, &thrusts);
  printf("then a tick: %d, thrust %d\n", (int)answer, (int)thrusts[0]);
}

int main(void) {
  *(float *)param_fullThrust = FULL_THRUST;
  *(float *)param_fullVoltage = FULL_VOLTAGE;
  controllerOutOfTreeInit();
  printf("by PWM: %d\n", *(const uint8_t *)param_pwm);
  printf("the controller's test: %d\n", controllerOutOfTreeTest());
  fly();
  lose_a_sensor();
  wait_for_orders();
  weaken();
  meet_special_values();
  damage();
  return 0;
}
