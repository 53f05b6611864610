/* A policy of Kestrel behind the neural interface of INDIflight and other forks of Betaflight, which call nn_control() in
 * their inner loop and take start_pos and start_yaw as the place from which the policy is let fly.
 *
 * Written by `kestrel export --target betaflight`. C99 and C++. World: north, east, down (m); body: forward, right, down. */
#ifndef NN_CONTROLLER_H
#define NN_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The place and the heading (rad) from which the policy starts, and its first goal. */
#ifndef NN_START_POSITION
#define NN_START_POSITION {0.0f, 0.0f, -1.0f}
#endif
#ifndef NN_START_YAW
#define NN_START_YAW 0.0f
#endif
extern const float start_pos[3];
extern const float start_yaw;

/* What the drone is; to be set before the first flight. */

/* Calls of nn_control() in a second: the rate of the inner loop, divided by nn_rate_denom. 0: the rate of the policy. */
extern uint32_t nn_calls_hz;
/* Greatest thrust of the drone by its weight. 0: that of the drone that the policy was trained with. */
extern float nn_thrust_to_weight;
/* A command of u gives (1 - k) u + k u u of a motor's greatest thrust; k, as `act_nonlinearity` / 100 in INDIflight. */
extern float nn_motor_nonlinearity;
/* A goal is flown to for so long after nn_set_goal(), microseconds; 0: until the next one. */
extern uint32_t nn_goal_timeout_us;

/* Reads the policy and computes its golden vectors: 0, or why it must not fly (kestrel.h). Takes 2.4 KB of stack and some
 * milliseconds: once, before arming. */
int32_t nn_test(void);

/* Before the policy takes over: forgets its past actions; the goal is the start, and fresh. */
void nn_reset(void);

/* Where to fly to: position, and heading (rad, clockwise from north). */
void nn_set_goal(const float position[3], float yaw);

/* One call of the inner loop. world_state: position, velocity, roll, pitch, yaw (rad), body rates (rad/s), and four motor
 * speeds, which are not read. motor_cmds: 0 to 1, in the order of QUADX: rear right, front right, rear left, front left.
 *
 * A state that is refused for a moment leaves the commands as they were. After that, and when the goal is stale, each motor
 * carries a quarter of the weight, and the firmware has to take over: `if (!nn_flies()) nn_deactivate();`. */
void nn_control(const float world_state[16], float motor_cmds[4]);

/* 0 while the policy flies, or why not: a code of kestrel.h, or KESTREL_STALE. */
int32_t nn_status(void);

/* Whether the commands are those of the policy, of this call or of one a moment ago. */
bool nn_flies(void);

#ifdef __cplusplus
}
#endif

#endif
