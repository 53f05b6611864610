/* Mass and greatest thrust of a motor, as of crazyflie-firmware's commit 2a18fc2; with battery compensation unless WITHOUT_COMPENSATION
 * is defined. */
#pragma once
#ifndef WITHOUT_COMPENSATION
#define CONFIG_ENABLE_THRUST_BAT_COMPENSATED
#endif
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
