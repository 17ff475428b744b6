/* The tracker: a step in each period, within the limits of the joints, from which they can always stop. */
#include <string.h>

#include "constants.h"
#include "kinseek.h"
#include "rows.h"

static int64_t handle[4 * KINSEEK_ROWS]; /* Of each array its address and three dimensions. */
static double memory[KINSEEK_MEMORY];
static double position_error, orientation_error;

/* The joint values that track the pose as fast as the limits of velocity allow. */
static struct {
    double reach[KINSEEK_DOF], now[KINSEEK_DOF], last[KINSEEK_DOF], low[KINSEEK_DOF], high[KINSEEK_DOF], reached[KINSEEK_DOF], drift[KINSEEK_DOF];
} aim;

/* The joints, which follow them within all limits. */
static struct {
    double q[KINSEEK_DOF], velocity[KINSEEK_DOF], acceleration[KINSEEK_DOF], target[KINSEEK_DOF], before[KINSEEK_DOF], rate[KINSEEK_DOF];
    double wanted[KINSEEK_DOF], desired[KINSEEK_DOF], braking[KINSEEK_DOF], extent[KINSEEK_DOF], rest[KINSEEK_DOF];
} joints;

static double none[1];

/* The kernels declare the first two as memory that they may write, and only read them. */
static const KinseekState state = {(double *)limit_lower, (double *)limit_upper, aim.reach, aim.now, aim.last, aim.low, aim.high, aim.reached, aim.drift};
static const KinseekMotion motion = {
    limit_lower, limit_upper, limit_velocity_limit, limit_acceleration_limit, limit_jerk_limit, joints.q, joints.velocity,
    joints.acceleration, joints.target, joints.before, joints.rate,
    joints.wanted, joints.desired, joints.braking, joints.extent, joints.rest,
};
static const KinseekRoom nothing = {none, none}; /* No pairs of bodies. */

static int told(int status, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF], double acceleration[KINSEEK_DOF]) {
    memcpy(q, joints.q, sizeof joints.q);
    memcpy(velocity, joints.velocity, sizeof joints.velocity);
    memcpy(acceleration, joints.acceleration, sizeof joints.acceleration);
    return status;
}

static int refused(double dt) {
    if (!handle[0]) return KINSEEK_NOT_STARTED;
    return dt >= KINSEEK_SHORTEST && dt <= KINSEEK_LONGEST ? KINSEEK_DONE : KINSEEK_BAD_TIME;
}

/* The status where a joint is kept from what was desired: one that brakes before its limit has not arrived there. */
static int kept_back(int64_t joint, int64_t kept) {
    bool arrived = joints.q[joint] <= limit_lower[joint] || joints.q[joint] >= limit_upper[joint];
    arrived = arrived || fabs(joints.velocity[joint]) < KINSEEK_AT_REST;
    return kept == KINSEEK_AT_POSITION && arrived ? KINSEEK_LIMIT : KINSEEK_LAGGING;
}

/* Change the velocities of the joints to those in joints.wanted. */
static int go(double dt) {
    int64_t joint = -1, kept = 0, pair = -1;
    int32_t failed = kinseek_limited_step(KINSEEK_DOF, 0, &motion, &nothing, dt, KINSEEK_GO, false, &joint, &kept, &pair);
    for (int i = 0; i < KINSEEK_DOF; i++) {
        aim.now[i] = joints.q[i];
        aim.last[i] = joints.velocity[i] * dt;
    }
    position_error = orientation_error = NAN;
    if (failed) return KINSEEK_FAILED;
    if (joint < 0) return KINSEEK_TRACKING;
    return kept_back(joint, kept);
}

static int brake(double dt) {
    memset(joints.wanted, 0, sizeof joints.wanted);
    return go(dt) == KINSEEK_FAILED ? KINSEEK_FAILED : KINSEEK_STOPPING;
}

int kinseek_track_start(const double q[KINSEEK_DOF]) {
    if (!kinseek_finite(q, KINSEEK_DOF)) return KINSEEK_NOT_FINITE;
    for (int row = 0; row < KINSEEK_ROWS; row++) {
        handle[4 * row] = (int64_t)(uintptr_t)rows[row].first;
        for (int i = 0; i < 3; i++) handle[4 * row + 1 + i] = rows[row].shape[i];
    }
    memset(&aim, 0, sizeof aim);
    memset(&joints, 0, sizeof joints);
    memcpy(aim.now, q, sizeof aim.now);
    memcpy(aim.reached, q, sizeof aim.reached);
    memcpy(joints.q, q, sizeof joints.q);
    memcpy(joints.target, q, sizeof joints.target);
    memcpy(joints.before, q, sizeof joints.before);
    position_error = orientation_error = NAN;
    return KINSEEK_DONE;
}

int kinseek_track_pose(const double pose[16], double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF], double acceleration[KINSEEK_DOF]) {
    int64_t ended = 0, joint = -1, kept = 0, pair = -1;
    int status = refused(dt);
    if (status < 0) return told(status, q, velocity, acceleration);
    if (!kinseek_finite(pose, 16)) return told(brake(dt), q, velocity, acceleration);
    for (int i = 0; i < KINSEEK_DOF; i++) aim.reach[i] = limit_velocity_limit[i] * dt;
    if (kinseek_track_step(KINSEEK_DOF, 0, (int64_t)(uintptr_t)handle, tolerances, pose, memory, KINSEEK_MEMORY, &state, &motion, &nothing, dt,
                           &position_error, &orientation_error, &ended, &joint, &kept, &pair)) {
        return told(KINSEEK_FAILED, q, velocity, acceleration);
    }
    if (ended == KINSEEK_LOOSE) {
        status = brake(dt);
        return told(status < 0 ? status : KINSEEK_NO_POSE, q, velocity, acceleration);
    }
    status = KINSEEK_TRACKING + (int)ended;
    if (joint >= 0) { /* The joints are not yet at the values that track the pose. */
        bool near = position_error <= KINSEEK_POSITION_TOLERANCE && orientation_error <= KINSEEK_ORIENTATION_TOLERANCE;
        status = near ? KINSEEK_TRACKING : kept_back(joint, kept);
    }
    return told(status, q, velocity, acceleration);
}

int kinseek_track_velocity(const double wanted[KINSEEK_DOF], double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF],
                           double acceleration[KINSEEK_DOF]) {
    int status = refused(dt);
    if (status < 0) return told(status, q, velocity, acceleration);
    if (!kinseek_usable(wanted, KINSEEK_DOF)) return told(brake(dt), q, velocity, acceleration);
    memcpy(joints.wanted, wanted, sizeof joints.wanted);
    return told(go(dt), q, velocity, acceleration);
}

int kinseek_track_stop(double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF], double acceleration[KINSEEK_DOF]) {
    int status = refused(dt);
    return told(status < 0 ? status : brake(dt), q, velocity, acceleration);
}

void kinseek_track_errors(double *position, double *orientation) {
    *position = position_error;
    *orientation = orientation_error;
}
