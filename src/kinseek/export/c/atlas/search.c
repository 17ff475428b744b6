/* The atlas: sorted samples of the arm, looked up and refined. They stand in flash; a table of where is made at the first call. */
#include "constants.h"
#include "kinseek.h"
#include "rows.h"

#if defined(__wasm__)
static const unsigned char kinseek_atlas[] __attribute__((aligned(64))) = {
#embed "atlas.bin"
};
#else
__asm__(
    ".section .rodata\n"
    ".balign 64\n"
    ".global kinseek_atlas\n"
    "kinseek_atlas:\n"
    ".incbin \"atlas.bin\"\n"
    ".balign 4\n"
    ".text\n");

extern const unsigned char kinseek_atlas[];
#endif

static int64_t routines[KINSEEK_ROUTINES]; /* Addresses of what the kernels call. */
static int64_t handle[4 * KINSEEK_ROWS];   /* Of each array its address and three dimensions. */
static int64_t evaluations;

static void set_up(void) {
    for (int row = 0; row < KINSEEK_ROWS; row++) {
        handle[4 * row] = (int64_t)(uintptr_t)(kinseek_atlas + rows[row][0]);
        for (int i = 1; i < 4; i++) handle[4 * row + i] = rows[row][i];
    }
    handle[4 * KINSEEK_ROUTINES_ROW] = (int64_t)(uintptr_t)routines;
    routines[KINSEEK_ITERATE] = (int64_t)(uintptr_t)ks_iterate_routine;
    routines[KINSEEK_SEARCH] = (int64_t)(uintptr_t)ks_search_routine;
    routines[KINSEEK_ENDING] = (int64_t)(uintptr_t)ks_ending_routine;
    routines[KINSEEK_FAR] = (int64_t)(uintptr_t)ks_far_routine;
#ifdef KINSEEK_CLOSED
    routines[KINSEEK_CLOSED] = (int64_t)(uintptr_t)ks_closed_routine; /* What geometry gives is not searched. */
#endif
}

int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]) {
    double position, orientation, weighted;
    bool reached = false;
    if (!kinseek_finite(pose, 16)) return KINSEEK_NOT_FINITE;
    if (!handle[0]) set_up();
    int64_t address = (int64_t)(uintptr_t)handle;
    if (kinseek_solve_plain(KINSEEK_DOF, address, pose, q, &position, &orientation, &weighted, &evaluations, &reached)) {
        return KINSEEK_FAILED;
    }
    if (evaluations < 0) return KINSEEK_NO_POSE;
    return reached ? KINSEEK_DONE : KINSEEK_MISSED;
}

int64_t kinseek_evaluations(void) { return evaluations; }
