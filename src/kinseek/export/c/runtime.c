/* What the kernels ask of a runtime: a little working memory, from one array of a fixed size, given back at the end of each
   call. A kernel that finds too little says so, and the call fails. */
#include <stdint.h>
#include <stddef.h>

#include "arm.h"

typedef struct {
    int64_t references;
    void *destructor, *context, *data;
    int64_t size;
    void *allocator;
} Head; /* The kernels count references in the first, and read the fourth. */

typedef struct {
    int64_t span; /* [bytes] from this block to the next. */
    Head head;
} Block;

static union {
    int64_t even;
    char bytes[KINSEEK_ROOM];
} room;
static int64_t used; /* [bytes] of blocks, from the beginning. */

void *NRT_MemInfo_alloc_aligned(int64_t size, uint32_t alignment);
void NRT_MemInfo_call_dtor(void *memory);

void *NRT_MemInfo_alloc_aligned(int64_t size, uint32_t alignment) {
    int64_t span = ((int64_t)sizeof(Block) + size + alignment + 7) / 8 * 8, at = 0;
    Block *block = (Block *)room.bytes;
    for (; at < used; at += block->span) {
        block = (Block *)(room.bytes + at);
        if (!block->head.references && block->span >= span) break;
    }
    if (at >= used) {
        if (at + span > KINSEEK_ROOM) return NULL;
        block = (Block *)(room.bytes + at);
        block->span = span;
        used = at + span;
    }
    uintptr_t first = (uintptr_t)(block + 1), even = alignment ? alignment : 1;
    block->head = (Head){1, NULL, NULL, (void *)((first + even - 1) / even * even), size, NULL};
    return &block->head;
}

void NRT_MemInfo_call_dtor(void *memory) {
    int64_t at = 0, last = 0;
    ((Head *)memory)->references = 0;
    while (at < used) {
        Block *block = (Block *)(room.bytes + at);
        at += block->span;
        if (block->head.references) last = at;
    }
    used = last; /* Whatever stands behind the last block that is held is free. */
}

#if defined(__arm__)
/* Tables for unwinding the stack name it; nothing unwinds here. */
__attribute__((weak)) void __aeabi_unwind_cpp_pr0(void) {}
#endif
