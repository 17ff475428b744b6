/* What the kernels ask of a runtime: a little working memory, from a fixed number of fixed places, given back at the end of
   each call. A kernel that finds none, or needs more than there is, says so, and the call fails. */
#include <stdint.h>
#include <stddef.h>

#include "arm.h"

typedef struct {
    int64_t references;
    void *destructor, *context, *data;
    int64_t size;
    void *allocator;
} Head; /* The kernels count references in the first, and read the fourth. */

enum { PLACES = 4, ALIGNMENT = 32 };

static struct {
    Head head;
    char room[KINSEEK_ROOM + ALIGNMENT];
} place[PLACES];

void *NRT_MemInfo_alloc_aligned(int64_t size, uint32_t alignment);
void NRT_MemInfo_call_dtor(void *memory);

void *NRT_MemInfo_alloc_aligned(int64_t size, uint32_t alignment) {
    if (size > KINSEEK_ROOM || alignment > ALIGNMENT) return NULL;
    for (int i = 0; i < PLACES; i++) {
        if (place[i].head.references) continue;
        uintptr_t first = (uintptr_t)place[i].room, even = alignment ? alignment : 1;
        void *data = (void *)((first + even - 1) / even * even);
        place[i].head = (Head){1, NULL, NULL, data, size, NULL};
        return &place[i].head;
    }
    return NULL;
}

void NRT_MemInfo_call_dtor(void *memory) { ((Head *)memory)->references = 0; }

#if defined(__arm__)
/* Tables for unwinding the stack name it; nothing unwinds here. */
__attribute__((weak)) void __aeabi_unwind_cpp_pr0(void) {}
#endif
