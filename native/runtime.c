/* The part of Numba's runtime that compiled kernels call: memory with a count of its references. */
#include <stdint.h>
#include <stdlib.h>

typedef struct {
    int64_t references;
    void *destructor, *context, *data;
    int64_t size;
    void *allocator;
} Memory;  /* The first four fields are laid out as in Numba: kernels count references in the first. */

void *NRT_MemInfo_alloc_aligned(size_t size, uint32_t alignment) {
    Memory *made = malloc(sizeof(Memory) + size + alignment);
    if (!made) return NULL;
    uintptr_t at = (uintptr_t)(made + 1);
    if (alignment) at = (at + alignment - 1) / alignment * alignment;
    *made = (Memory){1, NULL, NULL, (void *)at, (int64_t)size, NULL};
    return made;
}

void *NRT_MemInfo_alloc_safe_aligned(size_t size, uint32_t alignment) { return NRT_MemInfo_alloc_aligned(size, alignment); }
void *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }
void NRT_MemInfo_call_dtor(void *memory) { free(memory); }
void *NRT_Allocate(size_t size) { return malloc(size); }
void NRT_Free(void *memory) { free(memory); }

#if defined(WRAP_POW) && defined(__GLIBC__) && (defined(__x86_64__) || defined(__aarch64__))
/* A program linked today imports the `pow` of glibc 2.29, which differs from the older one only in an error handler that it
   no longer calls. `-Wl,--wrap=pow` and these lines import the oldest `pow`, which every system has. */
double oldest_pow(double, double);
#if defined(__x86_64__)
__asm__(".symver oldest_pow, pow@GLIBC_2.2.5");
#else
__asm__(".symver oldest_pow, pow@GLIBC_2.17");
#endif
double __wrap_pow(double x, double y) { return oldest_pow(x, y); }
#endif
