/* Whether a policy goes on flying: a state that is refused for a moment is forgiven, a set-point that is stale is not flown to.
 *
 * C99 and C++, without a library. Times are whole numbers, so that no option of a compiler takes a time for one that is not a
 * number. In every tick:
 *
 *   code = kestrel_tick(...);           or kestrel_refusal(observation) of an exported policy.c
 *   switch (kestrel_guard(&guard, code, age of the set-point, time since the last tick)) {
 *     case KESTREL_FLY:               command what the policy answered
 *     case KESTREL_HOLD:              command what was commanded last: no motor stops because of one lost sample
 *     case KESTREL_HAND_OVER:         another controller flies; guard.code says why
 *   }
 *
 * The policy flies again in the first tick that finds nothing to refuse; then it has to forget its past actions first
 * (kestrel_reset). */
#ifndef KESTREL_GUARD_H
#define KESTREL_GUARD_H

#include <stdint.h>

/* The set-point is older than it may be. Beside the codes of kestrel.h. */
#define KESTREL_STALE 120

typedef enum { KESTREL_HAND_OVER, KESTREL_HOLD, KESTREL_FLY } KestrelVerdict;

/* All zero: nothing flies yet, a set-point never grows old, and one refused tick is held. */
typedef struct {
  uint32_t hold_us;    /* for how long the last command is held while states are refused; at least one tick */
  uint32_t stale_us;   /* from which age on a set-point is stale; 0: never */
  uint32_t refused_us; /* for how long states have been refused */
  int32_t code;        /* of the last tick: 0, the check's, or KESTREL_STALE */
  int32_t flies;       /* whether the policy flew, or was held, in the last tick */
} KestrelGuard;

static inline KestrelVerdict kestrel_guard(KestrelGuard *guard, int32_t code, uint32_t setpoint_age_us, uint32_t tick_us) {
  const int32_t stale = guard->stale_us != 0 && setpoint_age_us >= guard->stale_us;
  guard->code = code != 0 ? code : stale ? KESTREL_STALE : 0;
  if (guard->code == 0) {
    guard->refused_us = 0;
    guard->flies = 1;
    return KESTREL_FLY;
  }
  if (stale || !guard->flies || (guard->refused_us != 0 && guard->refused_us >= guard->hold_us)) {
    guard->flies = 0;
    return KESTREL_HAND_OVER;
  }
  guard->refused_us += tick_us;
  return KESTREL_HOLD;
}

#endif
