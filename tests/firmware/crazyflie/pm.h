#pragma once
float pmGetBatteryVoltage(void); /* V */
