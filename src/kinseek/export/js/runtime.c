/* What compiled kernels ask of Numba's runtime, in WebAssembly: memory that counts its references. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct {
    int64_t references;
    void *destructor, *context, *data;
    int64_t size;
    void *allocator;
} Memory; /* The kernels count references in the first, and read the fourth. */

void *NRT_MemInfo_alloc_aligned(int64_t size, uint32_t alignment) {
    Memory *made = malloc(sizeof(Memory) + (size_t)size + alignment);
    if (!made) return NULL;
    uintptr_t at = (uintptr_t)(made + 1);
    if (alignment) at = (at + alignment - 1) / alignment * alignment;
    *made = (Memory){1, NULL, NULL, (void *)at, size, NULL};
    return made;
}

void NRT_MemInfo_call_dtor(void *memory) { free(memory); }
