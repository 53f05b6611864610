/* The header that `kestrel export --target crazyflie` writes. */
#pragma once

#include <stddef.h>
#include <stdint.h>

extern const uint8_t kestrel_policy[];
extern const size_t kestrel_policy_len;
