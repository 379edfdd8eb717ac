/* Points of a cloud into the cells of a window. Every sum and product is in the order in which
   numpy does it in the twin, so that both give the same cells to the last bit. */

#ifndef MAPDEAL_CLOUDS_H
#define MAPDEAL_CLOUDS_H

#include <math.h>
#include <stdint.h>

typedef struct {
  int is_placed;           /* whether points come in the map frame, not in the robot's */
  double x, y, cos, sin;   /* the robot; of its yaw, or if placed of minus its yaw */
  double offset_x, offset_y;
  double least_height, most_height, least_range, most_range; /* infinite for none */
  double corner_x, corner_y, frame_cos, frame_sin, resolution; /* of minus the frame's yaw */
  int64_t height, width;
  double farthest, rounding, tolerance, corner_size;
} CloudRule;

enum { CLOUD_NOT_FINITE = 1, CLOUD_HEIGHT, CLOUD_RANGE, CLOUD_OUTSIDE, CLOUD_MARKING };

/* Marks the cells of points in `hit`, adds to `counts` by the enum, and puts the points that have
   a direction as the robot sees them into `seen`; returns how many those are. */
static int64_t mark_cloud(const double *points, int64_t count, int64_t width, const CloudRule *rule,
                          uint8_t *hit, double *seen, int64_t *counts) {
  int64_t directions = 0;
  const int has_height = width > 2;
  const int is_limited = rule->least_range > -INFINITY || rule->most_range < INFINITY;
  const double large = 1e300; /* below it no distance overflows */
  for (int64_t k = 0; k < count; k++, points += width) {
    const double px = points[0], py = points[1];
    if (!isfinite(px) || !isfinite(py) || (has_height && !isfinite(points[2]))) {
      counts[CLOUD_NOT_FINITE]++;
      continue;
    }
    if (has_height && !(points[2] >= rule->least_height && points[2] <= rule->most_height)) {
      counts[CLOUD_HEIGHT]++;
      continue;
    }
    double sx = px, sy = py, x, y;
    if (rule->is_placed) {
      x = px - rule->offset_x;
      y = py - rule->offset_y;
      const double dx = x - rule->x, dy = y - rule->y;
      sx = dx * rule->cos - dy * rule->sin;
      sy = dx * rule->sin + dy * rule->cos;
    } else {
      x = (px * rule->cos - py * rule->sin) + rule->x - rule->offset_x;
      y = (px * rule->sin + py * rule->cos) + rule->y - rule->offset_y;
    }
    int has_direction = sx != 0 || sy != 0;
    if (is_limited || !(fabs(sx) < large && fabs(sy) < large)) {
      const double distance = hypot(sx, sy);
      if (is_limited && !(distance >= rule->least_range && distance <= rule->most_range)) {
        counts[CLOUD_RANGE]++;
        continue;
      }
      has_direction = distance > 0 && isfinite(distance);
    }
    if (has_direction) {
      seen[2 * directions] = sx;
      seen[2 * directions + 1] = sy;
      directions++;
    }
    const double ax = fabs(x), ay = fabs(y);
    if (!(ax <= rule->farthest && ay <= rule->farthest)) {
      counts[CLOUD_OUTSIDE]++;
      continue;
    }
    const double dx = x - rule->corner_x, dy = y - rule->corner_y;
    double largest = ax > ay ? ax : ay;
    largest = largest > rule->corner_size ? largest : rule->corner_size;
    double tolerance = rule->rounding * largest / rule->resolution;
    tolerance = tolerance > rule->tolerance ? tolerance : rule->tolerance;
    const double col =
        (dx * rule->frame_cos - dy * rule->frame_sin) / rule->resolution + tolerance;
    const double row =
        (dx * rule->frame_sin + dy * rule->frame_cos) / rule->resolution + tolerance;
    if (row >= 0 && row < (double)rule->height && col >= 0 && col < (double)rule->width) {
      hit[(int64_t)row * rule->width + (int64_t)col] = 1;
      counts[CLOUD_MARKING]++;
    } else {
      counts[CLOUD_OUTSIDE]++;
    }
  }
  return directions;
}

/* Puts angles, radians, into bins of a turn, each of which keeps its first and its last one. */
static void cover_angles(const double *angles, int64_t count, double turn, double half,
                         int64_t bins, double *first, double *last) {
  const double scale = (double)bins / turn;
  for (int64_t k = 0; k < count; k++) {
    double angle = angles[k] - turn * ceil((angles[k] - half) / turn);
    angle = angle < half ? angle : half; /* rounding may have passed it */
    int64_t bin = (int64_t)((angle + half) * scale);
    bin = bin < 0 ? 0 : bin >= bins ? bins - 1 : bin;
    if (angle < first[bin]) first[bin] = angle;
    if (angle > last[bin]) last[bin] = angle;
  }
}

#endif
