/* An arm on a processor that runs no Python: forward kinematics, and a search for joint values.

Lengths are in metres, angles in radians, joints in order from base to tip, poses 4 x 4 row by row (T_base_tip). Nothing is
allocated: all memory is static. So one search runs at a time, and no function may be called while another runs.
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
    KINSEEK_NO_POSE = -3     /* The pose is no rigid transform. */
};

/* Are all of them neither NaN nor infinite? */
bool kinseek_finite(const double *numbers, int count);

/* Write the pose of the tip at joint values q, which may lie outside the limits. */
int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]);

/* Search for joint values whose pose is as near to a wanted one as the search can come: KINSEEK_DONE, and q is the best found.
   KINSEEK_MISSED says so where the search knows tolerances and they are not met; see kinseek_errors. */
int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]);

/* Poses that the last search tried. */
int64_t kinseek_evaluations(void);

/* How far the tip at q is from a pose: position [m], and the weighted error that the search makes least. */
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
