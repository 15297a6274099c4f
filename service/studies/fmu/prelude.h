/* What every translation stands on: arrays with their lengths, Python's modulo, largest and smallest. */
#include <math.h>
#include <string.h>
typedef struct { double *p; int n; } Vec;
typedef struct { double *p; int n, m; } Mat;
static double floored(double a, double b) { double r = fmod(a, b); return r != 0.0 && (r < 0.0) != (b < 0.0) ? r + b : r; }
static double most(double a, double b) { return b > a ? b : a; }
static double least(double a, double b) { return b < a ? b : a; }
static int most_int(int a, int b) { return b > a ? b : a; }
