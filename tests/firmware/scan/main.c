/* Casts the beams of an exported policy in the maps of its rooms, from random places, and prints a digest of them. `mark` closes a
 * window of instruction_count.c: each scan is one. The output must be the same on every machine. */
#include <stdio.h>
#include <string.h>

#include "policy.h"

#define PLACES 300

static uint64_t state;

/* In [0, 1). */
static float uniform(void) {
  state = state * 6364136223846793005ull + 1442695040888963407ull;
  return (float)(state >> 40) / 16777216.0f;
}

__attribute__((noinline)) void mark(void) { __asm__ volatile(""); }

int main(void) {
  float beams[KESTREL_MEASUREMENTS];
  for (int room = 0; room < KESTREL_ROOMS; room++) {
    uint64_t digest = 0xcbf29ce484222325ull;
    int seen = 0;
    for (int place = 0; place < PLACES; place++) {
      const float position[3] = {8.0f * uniform() - 1.0f, 3.0f * uniform() - 1.5f, 1.5f * uniform()};
      mark();
      kestrel_scan(&kestrel_rooms[room], &position, beams);
      mark();
      for (int beam = 0; beam < KESTREL_MEASUREMENTS; beam++) {
        uint32_t bits;
        memcpy(&bits, &beams[beam], sizeof bits);
        digest = (digest ^ bits) * 0x100000001b3ull;
        seen += beams[beam] > 0.0f;
      }
    }
    printf("room %d: %d beams meet something, %08lx%08lx\n", room, seen, (unsigned long)(digest >> 32),
           (unsigned long)(digest & 0xffffffffu));
  }
  return 0;
}
