/* Flies nothing: feeds an exported policy random observations, of which one value in sixteen is any bit pattern, and prints
 * the FNV-1a digest of its actions. `mark` closes a window of instruction_count.c: each call of the policy is one. */
#include <stdio.h>
#include <string.h>

#include "policy.h"

#define INPUTS 2000

static uint64_t state;

static uint32_t next(void) {
  state = state * 6364136223846793005ull + 1442695040888963407ull;
  return (uint32_t)(state >> 32);
}

__attribute__((noinline)) void mark(void) { __asm__ volatile(""); }

int main(void) {
  static kestrel_scratch scratch;
  uint64_t digest = 0xcbf29ce484222325ull;
  int failed = kestrel_self_test(&scratch);
  for (int input = 0; input < INPUTS; input++) {
    float observation[KESTREL_OBSERVATION_LEN], action[KESTREL_ACTION_LEN];
    for (int index = 0; index < KESTREL_OBSERVATION_LEN; index++) {
      uint32_t bits = next();
      observation[index] = (float)((int32_t)bits >> 8) / 4194304.0f;
      if (next() % 16 == 0) memcpy(&observation[index], &bits, sizeof bits);
    }
    mark();
    kestrel_act(observation, &scratch, action);
    mark();
    unsigned char bytes[sizeof action];
    memcpy(bytes, action, sizeof action);
    for (unsigned index = 0; index < sizeof action; index++) digest = (digest ^ bytes[index]) * 0x100000001b3ull;
  }
  printf("%d %08lx%08lx\n", failed, (unsigned long)(digest >> 32), (unsigned long)(digest & 0xffffffff));
  return 0;
}
