/* An arm on a processor that runs no Python: forward kinematics, and a search for joint values or a tracker.

Lengths are in metres, angles in radians, joints in order from base to tip, poses 4 x 4 row by row (T_base_tip). Nothing is
allocated: all memory is static. So one search or tracker runs at a time, and no function may be called while another runs.
*/
#ifndef KINSEEK_H
#define KINSEEK_H

#include <stdbool.h>
#include <stdint.h>

#include "arm.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    KINSEEK_MORE = 0,
    KINSEEK_DONE = 1,
    KINSEEK_MISSED = 2,
    KINSEEK_NOT_FINITE = -1, /* A number that was given is NaN or infinite. */
    KINSEEK_FAILED = -2,     /* A kernel found no working memory. */
    KINSEEK_NO_POSE = -3,    /* The pose is no rigid transform, or its position is farther than 1e7 m away. */
    KINSEEK_BAD_TIME = -4,   /* dt is no duration: it is NaN, not above 0, or too long. */
    KINSEEK_NOT_STARTED = -5 /* kinseek_track_start or kinseek_begin was not called. */
};

#ifdef KINSEEK_TRACKER
/* The tracker: start it, then call one of the three steps in each period. A step writes joint values, velocities and
   accelerations at its end, and returns a status. With v = (q - q before) / dt and a = (v - v before) / dt, no step exceeds a
   limit of velocity, acceleration or jerk, or leaves the limits of the joints, and from every state the joints can brake within
   all of them. The limits are constants, see rows.h. There is no scene, no search for a lost pose, and no change to another
   branch: an arm that cannot reach the pose comes to rest at the nearest one of its branch. */
enum {
    KINSEEK_TRACKING = 3, /* The pose is reached within this period, or the velocities are. */
    KINSEEK_LAGGING,      /* The joints move as fast as they may, and the pose is farther away. */
    KINSEEK_LIMIT,        /* A joint is at its limit, and the hand cannot come nearer on this branch. */
    KINSEEK_SINGULAR,     /* Singular or out of reach: no joint is at its limit, and no motion brings the hand nearer. */
    KINSEEK_STOPPING      /* The joints brake: kinseek_track_stop, or the target contains NaN, infinity or a velocity beyond 1e7. */
    /* Of the errors, the joints brake for KINSEEK_NO_POSE, and nothing moves for all others. */
};

/* Start at joint values, at rest. A joint outside its limits returns as fast as it may. KINSEEK_DONE or KINSEEK_NOT_FINITE. */
int kinseek_track_start(const double q[KINSEEK_DOF]);

/* Move towards a pose as far as the time dt [s] allows; dt is the time since the step before, which may vary. */
int kinseek_track_pose(const double pose[16], double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF],
                       double acceleration[KINSEEK_DOF]);

/* Change to velocities of the joints. */
int kinseek_track_velocity(const double wanted[KINSEEK_DOF], double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF],
                           double acceleration[KINSEEK_DOF]);

/* Brake. */
int kinseek_track_stop(double dt, double q[KINSEEK_DOF], double velocity[KINSEEK_DOF], double acceleration[KINSEEK_DOF]);

/* How far the hand is from the pose of the last step [m], [rad]; NaN if that had no pose. */
void kinseek_track_errors(double *position, double *orientation);
#endif

/* Are all of them neither NaN nor infinite? */
bool kinseek_finite(const double *numbers, int count);

/* Are all of them also of at most KINSEEK_LARGEST? */
bool kinseek_usable(const double *numbers, int count);

/* Write the pose of the tip at joint values q, which may lie outside the limits. */
int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]);

#ifndef KINSEEK_TRACKER
/* Search for joint values whose pose is as near to a wanted one as the search can come: KINSEEK_DONE, and q is the best found.
   KINSEEK_MISSED says so where the search knows tolerances and they are not met; see kinseek_errors. */
int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]);

/* Poses that the last search tried. */
int64_t kinseek_evaluations(void);
#endif

/* How far the tip at q is from a pose: position [m], and the weighted error that a search makes least. */
int kinseek_errors(const double pose[16], const double q[KINSEEK_DOF], double *position, double *weighted);

#ifdef KINSEEK_GRID
/* The same search in parts, for a program that has more to do: begin, then go on until it is no longer KINSEEK_MORE. A part
   tries about `work` leaves; q is the best so far once one is tried. */
int kinseek_begin(const double pose[16]);
int kinseek_go_on(int64_t work, double q[KINSEEK_DOF]);

/* Nodes of the tree that were made so far. */
int64_t kinseek_nodes(void);
#endif

#ifdef __cplusplus
}
#endif

#endif
