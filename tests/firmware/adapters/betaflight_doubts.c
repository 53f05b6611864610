/* What the controller of Betaflight's forks does in doubt, a thousand calls a second: states with special values, a rate that is
 * lost for a moment and for longer, a goal that grows old. */
#include <stdio.h>
#include <string.h>

#include "kestrel.h"
#include "nn_controller.h"

#define SPECIAL_STATES 12000

/* Calls from one action to the next. */
#define PERIOD 20

static uint64_t state = 1;
static float motor_cmds[4];

static uint32_t next(void) {
  state = state * 6364136223846793005ull + 1442695040888963407ull;
  return (uint32_t)(state >> 32);
}

/* Not a number (quiet, signalling), infinite, subnormal, zero, huge, or about as large as the limits. */
static float special(void) {
  const uint32_t bits = next();
  const uint32_t kinds[] = {
      (bits & 0x803fffffu) | 0x7fc00000u, (bits & 0x803fffffu) | 0x7f800001u, (bits & 0x80000000u) | 0x7f800000u,
      bits & 0x807fffffu, bits & 0x80000000u, (bits & 0x80ffffffu) | 0x7e000000u, (bits & 0x83ffffffu) | 0x40000000u,
  };
  float value;
  memcpy(&value, &kinds[next() % 7], sizeof value);
  return value;
}

/* One call in hover at the start, but for one number. */
static void call(int index, float value) {
  float world_state[16] = {0.0f, 0.0f, -1.0f};
  if (index >= 0) world_state[index] = value;
  nn_control(world_state, motor_cmds);
}

/* Motors that are told nothing, too much, or what is not a number. */
static int stopped(void) {
  int count = 0;
  for (int motor = 0; motor < 4; motor++) count += !(motor_cmds[motor] > 0.01f && motor_cmds[motor] <= 1.0f);
  return count;
}

static void meet_special_values(void) {
  int refused = 0, motors = 0;
  for (int input = 0; input < SPECIAL_STATES; input++) {
    nn_reset();
    call(-1, 0.0f);
    motors += stopped();
    /* A period later the policy acts again. */
    const float value = special();
    for (int again = 0; again < PERIOD; again++) call(input % 12, value);
    refused += nn_status() != 0;
    motors += nn_status() != 0 ? stopped() : 0;
  }
  printf("of %d special states %d refused, %d motors stopped in doubt\n", SPECIAL_STATES, refused, motors);
}

static void lose_a_rate(void) {
  const uint32_t not_a_number = 0x7fc00000u;
  float lost;
  int flown = 0, motors = 0;
  memcpy(&lost, &not_a_number, sizeof lost);
  nn_reset();
  for (int step = 0; step < 200; step++) {
    call(step == 2 * PERIOD || step >= 5 * PERIOD ? 9 : -1, lost);
    flown += nn_flies();
    motors += stopped();
  }
  printf("of 200 calls, 101 without a rate: %d of the policy, %d motors stopped, then code %d\n", flown, motors, (int)nn_status());
  call(-1, 0.0f);
  printf("with the rate again it flies: %d\n", nn_flies());
}

static void wait_for_a_goal(void) {
  int flown = 0;
  nn_goal_timeout_us = 500000;
  nn_reset();
  for (int step = 0; step < 1000; step++) {
    call(-1, 0.0f);
    flown += nn_flies();
  }
  printf("a goal is flown to for %d ms, then code %d\n", flown, (int)nn_status());
}

int main(void) {
  nn_calls_hz = 1000;
  printf("self-test: %d\n", (int)nn_test());
  meet_special_values();
  lose_a_rate();
  wait_for_a_goal();
  return 0;
}
