#pragma once

/// Compiles a function for the machine's vector unit as well as for the oldest one, chosen at start.
/// Not under sanitizers, whose runtime is not ready when that choice is made.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define GANTRY_MULTIVERSION __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define GANTRY_MULTIVERSION
#endif
