/* Start of a program on a Cortex-M with an FPU, as QEMU has it. */
void reset(void);
extern void _start(void);

static const struct {
    void *stack;
    void (*start)(void);
} vectors __attribute__((section(".vectors"), used)) = {(void *)0x20400000, reset};

void reset(void)
{
    *(volatile unsigned *)0xE000ED88 |= 0xFu << 20; /* The FPU is on. */
    __asm__ volatile("dsb\n isb");
    _start();
}
