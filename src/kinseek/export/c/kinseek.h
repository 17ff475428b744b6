/* An arm on a processor that runs no Python: forward kinematics, and divide and conquer with its dynamic tree.

Lengths are in metres, angles in radians, joints in order from base to tip, poses 4 x 4 row by row (T_base_tip). Nothing is
allocated: all memory is static. So one search runs at a time, and no function may be called while another runs.
*/
#ifndef KINSEEK_H
#define KINSEEK_H

#include <stdbool.h>
#include <stdint.h>

#include "arm.h"

enum { KINSEEK_MORE = 0, KINSEEK_DONE = 1, KINSEEK_NOT_FINITE = -1, KINSEEK_FAILED = -2 };

/* Write the pose of the tip at joint values q, which may lie outside the limits. */
int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]);

/* Search for joint values whose pose is as near to a wanted one as the grid allows: all of it, from the beginning. */
int kinseek_solve(const double pose[16], double q[KINSEEK_DOF]);

/* The same in parts, for a program that has more to do: begin, then go on until it is KINSEEK_DONE. A part tries about `work`
   leaves; q is the best so far once one is tried. */
int kinseek_begin(const double pose[16]);
int kinseek_go_on(int64_t work, double q[KINSEEK_DOF]);

/* What the search has done so far: leaves are tips that were compared with the goal, nodes are all of the tree. */
int64_t kinseek_leaves(void);
int64_t kinseek_nodes(void);

/* How far the tip at q is from a pose: position [m], and the weighted error that the search makes least. */
int kinseek_errors(const double pose[16], const double q[KINSEEK_DOF], double *position, double *weighted);

#endif
