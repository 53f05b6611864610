#pragma once
#include "FreeRTOS.h"
typedef void *TaskHandle_t;
typedef void (*TaskFunction_t)(void *);
uint32_t xTaskGetTickCount(void);
void vTaskDelay(uint32_t ticks);
void vTaskDelete(TaskHandle_t task);
UBaseType_t uxTaskPriorityGet(TaskHandle_t task);
TaskHandle_t xTaskCreateStatic(TaskFunction_t code, const char *name, uint32_t stack_words, void *argument,
                               UBaseType_t priority, StackType_t *stack, StaticTask_t *task);
