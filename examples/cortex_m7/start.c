/* What starts a Cortex-M7 without an operating system, and says how much stack a program took. For the emulated board
   mps2-an500, whose loader fills all memory; a part of your own has files of its maker for this. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

extern uint32_t stack_end[], stack_top[], __bss_start__[], __bss_end__[];
extern void initialise_monitor_handles(void); /* Of newlib: printf goes through the debugger. */
extern int main(void);

void reset(void);

enum { PAINT = 0x5AFE5AFE };

static void stop(void) {
    for (;;) __asm volatile("bkpt 1");
}

void reset(void) {
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* The floating-point unit on (CPACR). */
    __asm volatile("dsb\n isb");
    for (uint32_t *at = __bss_start__; at < __bss_end__; at++) *at = 0;
    uint32_t *here;
    __asm volatile("mov %0, sp" : "=r"(here));
    for (uint32_t *at = stack_end; at < here - 16; at++) *at = PAINT;
    initialise_monitor_handles();
    int code = main();
    uint32_t *at = stack_end;
    while (at < stack_top && *at == PAINT) at++;
    printf("stack: %ld bytes\n", (long)(4 * (stack_top - at)));
    exit(code);
}

void _fini(void) {}

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {stack_top, reset, stop, stop, stop, stop, stop};
