/* Solve one goal, and compare with what kinseek answered where this was written. */
#include <math.h>
#include <stdio.h>

#include "goal.h"
#include "kinseek.h"

int main(void) {
    double q[KINSEEK_DOF], pose[16], position = 0.0, weighted = 0.0, apart = 0.0, off = 0.0;
    int state = kinseek_solve(goal_pose, q);
    if (state < 0) {
        printf("the search failed (%d)\n", state);
        return 2;
    }
    kinseek_errors(goal_pose, q, &position, &weighted);
    printf("%s: %ld poses tried, %.6f mm off, weighted error %.3e\n", KINSEEK_NAME, (long)kinseek_evaluations(), 1e3 * position, weighted);
    for (int i = 0; i < KINSEEK_DOF; i++) {
        printf("%s %.17g\n", joint_names[i], q[i]);
        apart = fmax(apart, fabs(q[i] - expected_q[i]));
    }
    kinseek_fk(expected_q, pose);
    for (int i = 0; i < 16; i++) off = fmax(off, fabs(pose[i] - expected_pose[i]));
    printf("beside kinseek: joint values at most %g apart, %ld of %ld poses tried, FK at most %g\n", apart, (long)kinseek_evaluations(),
           (long)EXPECTED_EVALUATIONS, off);
    return apart < 1e-9 && off < 1e-12 ? 0 : 1;
}
