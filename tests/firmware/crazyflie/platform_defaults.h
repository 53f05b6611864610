/* Mass and greatest thrust of a motor with battery compensation, as of crazyflie-firmware's commit 2a18fc2. */
#pragma once
#if defined(CONFIG_PLATFORM_CF21BL)
#define CF_MASS 0.0393f /* kg */
#define THRUST_MAX 0.2f /* N */
#elif defined(CONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT)
#define CF_MASS 0.0325f
#define THRUST_MAX 0.18f
#else
#define CF_MASS 0.029f
#define THRUST_MAX 0.12f
#endif
