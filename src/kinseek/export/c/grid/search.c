/* Divide and conquer: the plan of its passes, and all memory that it takes. */
#include <string.h>

#include "constants.h"
#include "kinseek.h"
#include "plan.h"

static double memory[KINSEEK_MEMORY];
static double wanted[12]; /* The first three rows of the pose. */
static int64_t progress[KINSEEK_PROGRESS];
static bool begun;

static const int64_t beginning[KINSEEK_PROGRESS] = KINSEEK_BEGINNING;

int kinseek_begin(const double pose[16]) {
    begun = false; /* If the pose is refused. */
    if (!kinseek_finite(pose, 12)) return KINSEEK_NOT_FINITE;
    if (!kinseek_usable(pose, 12)) return KINSEEK_NO_POSE;
    memcpy(wanted, pose, sizeof wanted);
    memcpy(progress, beginning, sizeof progress);
    begun = true;
    return KINSEEK_MORE;
}

int kinseek_go_on(int64_t work, double q[KINSEEK_DOF]) {
    const KinseekGoalArrays goal = {wanted, KINSEEK_POSITION_WEIGHT, axis_weights};
    int64_t ended = 0;
    if (!begun) return KINSEEK_NOT_STARTED;
    int32_t failed = kinseek_descend(KINSEEK_JOINTS, KINSEEK_DOF, KINSEEK_PASSES, &chain, &goal, &grid, &passes, work, memory,
                                     KINSEEK_MEMORY, progress, q, &ended);
    if (failed) return KINSEEK_FAILED;
    return ended == KINSEEK_PAUSED ? KINSEEK_MORE : KINSEEK_DONE;
}

int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]) {
    int state = kinseek_begin(pose);
    while (state == KINSEEK_MORE) state = kinseek_go_on(KINSEEK_PART, q);
    return state;
}

int64_t kinseek_evaluations(void) { return progress[KINSEEK_LEAVES]; }

int64_t kinseek_nodes(void) { return progress[KINSEEK_NODES]; }
