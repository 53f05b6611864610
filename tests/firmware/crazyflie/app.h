/* What the app uses of crazyflie-firmware, by the same names: for tests without its source. */
#pragma once
void appMain(void);
