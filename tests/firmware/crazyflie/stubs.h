/* What the app calls of a firmware, in one that does nothing: a clock of milliseconds, tasks that run at once on the stack of who
 * creates them, and a PID controller. Included once in a program, which may define RUN_TASK. */
#pragma once
#include <string.h>

#include "controller_pid.h"
#include "task.h"

#ifndef RUN_TASK
#define RUN_TASK(CODE, ARGUMENT, STACK_WORDS) ((void)(STACK_WORDS), (CODE)(ARGUMENT))
#endif

static uint32_t now;

uint32_t xTaskGetTickCount(void) { return now; }
void vTaskDelay(uint32_t ticks) { (void)ticks; }
void vTaskDelete(TaskHandle_t task) { (void)task; }
UBaseType_t uxTaskPriorityGet(TaskHandle_t task) { return task == NULL; }
TaskHandle_t xTaskCreateStatic(TaskFunction_t code, const char *name, uint32_t stack_words, void *argument,
                               UBaseType_t priority, StackType_t *stack, StaticTask_t *task) {
  (void)name, (void)priority, (void)stack;
  RUN_TASK(code, argument, stack_words);
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
