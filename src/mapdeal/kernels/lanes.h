/* Hot loops are compiled twice where the system can choose between them at load time. */

#ifndef MAPDEAL_LANES_H
#define MAPDEAL_LANES_H

#include <stdint.h>

#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define MANY_LANES __attribute__((target_clones("avx2", "default")))
#else
#define MANY_LANES
#endif

#endif
