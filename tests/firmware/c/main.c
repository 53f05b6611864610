/* Flies nothing: feeds an exported policy random observations, of which one value in sixteen is any bit pattern, and prints
 * the FNV-1a digest of its actions, then that of 12,000 observations of which half the values are special. `mark` closes a window of instruction_count.c: each call of the policy is one. */
#include <stdio.h>
#include <string.h>

#include "policy.h"

#define INPUTS 2000
#define SPECIAL_INPUTS 12000

static uint64_t state;

static uint32_t next(void) {
  state = state * 6364136223846793005ull + 1442695040888963407ull;
  return (uint32_t)(state >> 32);
}

/* Not a number (quiet, signalling), infinite, subnormal, zero, huge, about as large as the limit of the network's inputs. */
static uint32_t special(uint32_t kind, uint32_t bits) {
  switch (kind) {
    case 0: return (bits & 0x803fffffu) | 0x7fc00000u;
    case 1: return (bits & 0x803fffffu) | 0x7f800001u;
    case 2: return (bits & 0x80000000u) | 0x7f800000u;
    case 3: return bits & 0x807fffffu;
    case 4: return bits & 0x80000000u;
    case 5: return (bits & 0x80ffffffu) | 0x7e000000u;
    default: return (bits & 0x83ffffffu) | 0x40000000u;
  }
}

static uint64_t digest = 0xcbf29ce484222325ull;

static void add(const float action[KESTREL_ACTION_LEN]) {
  unsigned char bytes[KESTREL_ACTION_LEN * sizeof(float)];
  memcpy(bytes, action, sizeof bytes);
  for (unsigned index = 0; index < sizeof bytes; index++) digest = (digest ^ bytes[index]) * 0x100000001b3ull;
}

static void print_digest(const char *what) {
  printf("%s %08lx%08lx\n", what, (unsigned long)(digest >> 32), (unsigned long)(digest & 0xffffffff));
}

__attribute__((noinline)) void mark(void) { __asm__ volatile(""); }

int main(void) {
  static kestrel_scratch scratch;
  float observation[KESTREL_OBSERVATION_LEN], action[KESTREL_ACTION_LEN];
  int refused = 0;
  printf("%d failed in the self-test\n", kestrel_self_test(&scratch));
  for (int input = 0; input < INPUTS; input++) {
    for (int index = 0; index < KESTREL_OBSERVATION_LEN; index++) {
      uint32_t bits = next();
      observation[index] = (float)((int32_t)bits >> 8) / 4194304.0f;
      if (next() % 16 == 0) memcpy(&observation[index], &bits, sizeof bits);
    }
    mark();
    kestrel_act(observation, &scratch, action);
    mark();
    add(action);
  }
  print_digest("2000 inputs:");
  for (int input = 0; input < SPECIAL_INPUTS; input++) {
    for (int index = 0; index < KESTREL_OBSERVATION_LEN; index++) {
      const uint32_t bits = next(), choice = next();
      const uint32_t other = special(choice / 16 % 7, bits);
      observation[index] = (float)((int32_t)bits >> 8) / 4194304.0f;
      if (choice % 2 == 0) memcpy(&observation[index], &other, sizeof other);
    }
    refused += kestrel_refusal(observation) != 0;
    kestrel_act(observation, &scratch, action);
    add(action);
  }
  printf("%d refused of ", refused);
  print_digest("12000 special inputs:");
  return 0;
}
