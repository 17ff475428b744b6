/* The functions of kinseek.h, with the constants of the arm and all memory of a search. */
#include "kinseek.h"

#include <math.h>
#include <string.h>

#include "constants.h"
#include "kernels.h"

static double memory[KINSEEK_MEMORY];
static double wanted[12]; /* The first three rows of the pose. */
static int64_t at[KINSEEK_AT];

static const int64_t beginning[KINSEEK_AT] = KINSEEK_BEGINNING;

static bool all_finite(const double *numbers, int count) {
    for (int i = 0; i < count; i++) {
        if (!isfinite(numbers[i])) return false;
    }
    return true;
}

int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]) {
    if (!all_finite(q, KINSEEK_DOF)) return KINSEEK_NOT_FINITE;
    return kinseek_write_poses(KINSEEK_JOINTS, KINSEEK_DOF, 1, &chain, q, pose) ? KINSEEK_FAILED : KINSEEK_DONE;
}

int kinseek_begin(const double pose[16]) {
    if (!all_finite(pose, 12)) return KINSEEK_NOT_FINITE;
    memcpy(wanted, pose, sizeof wanted);
    memcpy(at, beginning, sizeof at);
    return KINSEEK_MORE;
}

int kinseek_go_on(int64_t work, double q[KINSEEK_DOF]) {
    const KinseekGoalArrays goal = {wanted, KINSEEK_POSITION_WEIGHT, axis_weights};
    bool done = false;
    int32_t failed = kinseek_descend(KINSEEK_JOINTS, KINSEEK_DOF, &chain, &goal, &grid, &passes, INT64_MAX, work, memory,
                                     KINSEEK_MEMORY, at, q, &done);
    if (failed) return KINSEEK_FAILED;
    return done ? KINSEEK_DONE : KINSEEK_MORE;
}

int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]) {
    int state = kinseek_begin(pose);
    while (state == KINSEEK_MORE) state = kinseek_go_on(KINSEEK_PART, q);
    return state;
}

int64_t kinseek_leaves(void) { return at[KINSEEK_TRIED]; }

int64_t kinseek_nodes(void) { return at[KINSEEK_VISITED]; }

int kinseek_errors(const double pose[16], const double q[KINSEEK_DOF], double *position, double *weighted) {
    double tip[16], square = 0.0, turned = 0.0;
    int state = kinseek_fk(q, tip);
    if (state != KINSEEK_DONE) return state;
    for (int row = 0; row < 3; row++) {
        double apart = tip[4 * row + 3] - pose[4 * row + 3];
        square += apart * apart;
    }
    for (int column = 0; column < 3; column++) {
        double cosine = 0.0;
        for (int row = 0; row < 3; row++) cosine += tip[4 * row + column] * pose[4 * row + column];
        turned += axis_weights[column] * (1.0 - cosine);
    }
    *position = sqrt(square);
    *weighted = KINSEEK_POSITION_WEIGHT * *position + turned;
    return KINSEEK_DONE;
}
