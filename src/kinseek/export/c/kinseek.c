/* Forward kinematics of the arm. */
#include "kinseek.h"

#include <math.h>

#include "constants.h"

bool kinseek_finite(const double *numbers, int count) {
    for (int i = 0; i < count; i++) {
        if (!isfinite(numbers[i])) return false;
    }
    return true;
}

bool kinseek_usable(const double *numbers, int count) {
    for (int i = 0; i < count; i++) {
        if (!(fabs(numbers[i]) <= KINSEEK_LARGEST)) return false;
    }
    return true;
}

int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]) {
    if (!kinseek_finite(q, KINSEEK_DOF)) return KINSEEK_NOT_FINITE;
    return kinseek_write_poses(KINSEEK_JOINTS, KINSEEK_DOF, 1, &chain, q, pose) ? KINSEEK_FAILED : KINSEEK_DONE;
}

int kinseek_errors(const double pose[16], const double q[KINSEEK_DOF], double *position, double *weighted) {
    double tip[16], square = 0.0, turned = 0.0;
    int state = kinseek_finite(pose, 16) ? kinseek_fk(q, tip) : KINSEEK_NOT_FINITE;
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
