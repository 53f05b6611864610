/* What the app calls of crazyflie-firmware: a clock that the tests set, tasks that run at once, and a PID controller that does
 * nothing. */
#include "firmware.h"

#include <string.h>

#include "controller_pid.h"
#include "task.h"

uint32_t now;

/* A task runs at once, on the stack of who creates it. */
uint32_t xTaskGetTickCount(void) { return now; }
void vTaskDelay(uint32_t ticks) { (void)ticks; }
void vTaskDelete(TaskHandle_t task) { (void)task; }
UBaseType_t uxTaskPriorityGet(TaskHandle_t task) { return task == NULL; }
TaskHandle_t xTaskCreateStatic(TaskFunction_t code, const char *name, uint32_t stack_words, void *argument,
                               UBaseType_t priority, StackType_t *stack, StaticTask_t *task) {
  (void)name, (void)stack_words, (void)priority, (void)stack;
  code(argument);
  return task;
}
void controllerPidInit(void) {}
bool controllerPidTest(void) { return true; }

void controllerPid(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state,
                   const stabilizerStep_t stabilizerStep) {
  (void)setpoint, (void)sensors, (void)state, (void)stabilizerStep;
  memset(control, 0, sizeof *control);
  control->controlMode = controlModeLegacy;
}
