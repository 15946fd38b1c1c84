// The x86-64 microarchitecture level that the processor and the operating system support.
#if defined(__x86_64__)
#include <cpuid.h>

static unsigned long long saved_state(void) {
    unsigned low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (unsigned long long)high << 32 | low;
}

// 2, 3 or 4 as in the x86-64 psABI (AVX2 and FMA from 3 on, AVX-512 F, BW, CD, DQ and VL from 4 on).
EXPORT int64_t rr1_cpu_level(void) {
    unsigned a, b, c, d, b7, c7, d7, c81;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1)) return 2;
    if (!__get_cpuid_count(7, 0, &a, &b7, &c7, &d7)) return 2;
    if (!__get_cpuid(0x80000001, &a, &b, &c81, &d)) return 2;
    const unsigned base = 1u << 12 | 1u << 22 | 1u << 28 | 1u << 29;           // FMA, MOVBE, AVX, F16C
    const unsigned bits = 1u << 3 | 1u << 5 | 1u << 8;                           // BMI1, AVX2, BMI2
    const unsigned wide = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;  // AVX-512 F, DQ, CD, BW, VL
    unsigned long long state = saved_state();
    if ((c & base) != base || (b7 & bits) != bits || !(c81 >> 5 & 1) || (state & 0x6) != 0x6) return 2;
    if ((b7 & wide) != wide || (state & 0xe6) != 0xe6) return 3;
    return 4;
}
#else
EXPORT int64_t rr1_cpu_level(void) { return 0; }
#endif
