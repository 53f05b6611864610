/* Start of a program on the STM32F405 in QEMU, with newlib's files by semihosting. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;
int main(void);
void initialise_monitor_handles(void);

static void start(void) {
  *(volatile uint32_t *)0xe000ed88 |= 0xfu << 20; /* CPACR: the FPU */
  memcpy(&data_start, &data_load, (size_t)((char *)&data_end - (char *)&data_start));
  memset(&bss_start, 0, (size_t)((char *)&bss_end - (char *)&bss_start));
  initialise_monitor_handles();
  exit(main());
}

static void fault(void) { abort(); }

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {&stack_top, start, fault, fault, fault, fault, fault};
