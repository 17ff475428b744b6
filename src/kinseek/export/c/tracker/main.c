/* Track a pose that moves, then brake, and compare with what kinseek computed where this was written. */
#include <math.h>
#include <stdio.h>

#include "goal.h"
#include "kinseek.h"

static const char *word(int status) {
    static const char *const words[] = {"tracking", "lagging", "at a limit", "singular or out of reach", "stopping"};
    return status >= KINSEEK_TRACKING && status <= KINSEEK_STOPPING ? words[status - KINSEEK_TRACKING] : "failed";
}

int main(void) {
    double q[KINSEEK_DOF], velocity[KINSEEK_DOF], acceleration[KINSEEK_DOF], pose[16], position, orientation, apart = 0.0;
    int status = kinseek_track_start(start_q);
    for (int k = 1; k <= STEPS && status >= 0; k++) {
        if (k <= TRACKED) { /* Your program takes the pose from a camera or an operator, and waits for the next period. */
            for (int i = 0; i < KINSEEK_DOF; i++) q[i] = swing_from[i] + swing_by[i] * (0.5 - 0.5 * cos(RATE * k));
            kinseek_fk(q, pose);
            status = kinseek_track_pose(pose, KINSEEK_PERIOD, q, velocity, acceleration);
        } else {
            status = kinseek_track_stop(KINSEEK_PERIOD, q, velocity, acceleration);
        }
        /* Here it sends q, or the velocities, to the joints. */
        for (int i = 0; i < KINSEEK_DOF; i++) {
            if (k == TRACKED) apart = fmax(apart, fabs(q[i] - expected_q[i]));
            if (k == STEPS) apart = fmax(apart, fabs(q[i] - expected_rest[i]));
        }
        kinseek_track_errors(&position, &orientation);
        if (k % 150 == 0) printf("%.3f s: %s, %.6f mm and %.6f mrad off\n", k * KINSEEK_PERIOD, word(status), 1e3 * position, 1e3 * orientation);
    }
    if (status < 0) {
        printf("the tracker failed (%d)\n", status);
        return 2;
    }
    for (int i = 0; i < KINSEEK_DOF; i++) printf("%s %.17g, velocity %g\n", joint_names[i], q[i], velocity[i]);
    printf("beside kinseek: joint values at most %g apart\n", apart);
    return apart < 1e-6 ? 0 : 1;
}
