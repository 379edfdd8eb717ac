/* Hot loops are compiled several times where the system can choose between them at load time. */

#ifndef MAPDEAL_LANES_H
#define MAPDEAL_LANES_H

#include <stdint.h>

#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#if __GNUC__ >= 12
#define MANY_LANES __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#else
#define MANY_LANES __attribute__((target_clones("avx2", "default")))
#endif
#else
#define MANY_LANES
#endif

#endif
