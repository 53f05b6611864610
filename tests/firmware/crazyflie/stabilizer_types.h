/* The fields that the app uses of crazyflie-firmware's interface, as of its commit 2a18fc2. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

typedef struct { float x, y, z; } Axis3f;
typedef struct { float x, y, z; } point_t;
typedef struct { float x, y, z; } velocity_t;
typedef struct { float x, y, z, w; } quaternion_t;
typedef struct { Axis3f gyro; } sensorData_t; /* deg/s */
typedef struct { float roll, pitch, yaw; } attitude_t; /* deg, or deg/s */
typedef struct {
  attitude_t attitude;
  quaternion_t attitudeQuaternion;
  point_t position;
  velocity_t velocity;
} state_t;
#define STABILIZER_NR_OF_MOTORS 4
typedef enum { controlModeLegacy = 0, controlModeForceTorque = 1, controlModeForce = 2 } control_mode_t;
typedef struct {
  float normalizedForces[STABILIZER_NR_OF_MOTORS];
  control_mode_t controlMode;
} control_t;
typedef enum { modeDisable = 0, modeAbs, modeVelocity } stab_mode_t;
typedef struct {
  uint32_t timestamp;
  attitude_t attitude, attitudeRate;
  point_t position;
  struct { stab_mode_t x, y, z, roll, pitch, yaw, quat; } mode;
} setpoint_t;
typedef uint32_t stabilizerStep_t;
#define RATE_MAIN_LOOP 1000
