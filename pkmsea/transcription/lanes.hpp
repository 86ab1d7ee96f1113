// Runs CasADi's generated code on several instants at once: `casadi_real` becomes a vector with one lane per instant.
#include <cmath>

namespace lanes {

constexpr int COUNT = 8;  // instants per call

struct Real {
  typedef double Vector __attribute__((vector_size(COUNT * sizeof(double))));
  Vector x;
  Real() = default;
  Real(double value) : x(Vector{} + value) {}
  Real(Vector value) : x(value) {}
};

inline Real operator+(Real a, Real b) { return a.x + b.x; }
inline Real operator-(Real a, Real b) { return a.x - b.x; }
inline Real operator*(Real a, Real b) { return a.x * b.x; }
inline Real operator/(Real a, Real b) { return a.x / b.x; }
inline Real operator-(Real a) { return -a.x; }

#define LANE_BY_LANE(NAME) \
  inline Real NAME(Real a) { for (int i = 0; i < COUNT; ++i) a.x[i] = std::NAME(a.x[i]); return a; }
#define LANE_BY_LANE_2(NAME) \
  inline Real NAME(Real a, Real b) { for (int i = 0; i < COUNT; ++i) a.x[i] = std::NAME(a.x[i], b.x[i]); return a; }
LANE_BY_LANE(sin) LANE_BY_LANE(cos) LANE_BY_LANE(tan) LANE_BY_LANE(asin) LANE_BY_LANE(acos) LANE_BY_LANE(atan)
LANE_BY_LANE(asinh) LANE_BY_LANE(sinh) LANE_BY_LANE(cosh) LANE_BY_LANE(tanh) LANE_BY_LANE(exp) LANE_BY_LANE(log) LANE_BY_LANE(sqrt)
LANE_BY_LANE(fabs) LANE_BY_LANE(log1p) LANE_BY_LANE(expm1) LANE_BY_LANE_2(atan2) LANE_BY_LANE_2(pow) LANE_BY_LANE_2(fmin) LANE_BY_LANE_2(fmax)

typedef int Function(const Real** in, Real** out, long long* iw, Real* w, int memory);

// Evaluates `function` at `count` instants; in[j] and out[j] are arrays of `count` rows of rows_in[j] or rows_out[j].
template <int N_IN, int N_OUT, int WIDTH>
void run(Function* function, long count, const double* const* in, double* const* out,
         const int (&rows_in)[N_IN], const int (&rows_out)[N_OUT]) {
  Real memory[WIDTH];
  const Real* from[N_IN];
  Real* to[N_OUT];
  for (long k = 0; k < count; k += COUNT) {
    const long left = count - k < COUNT ? count - k : COUNT;
    Real* next = memory;
    for (int j = 0; j < N_IN; ++j) {
      from[j] = next;
      for (int lane = 0; lane < COUNT; ++lane) {
        const double* row = in[j] + (k + (lane < left ? lane : left - 1)) * rows_in[j];
        for (int i = 0; i < rows_in[j]; ++i) next[i].x[lane] = row[i];
      }
      next += rows_in[j];
    }
    for (int j = 0; j < N_OUT; ++j) {
      to[j] = next;
      next += rows_out[j];
    }
    function(from, to, nullptr, nullptr, 0);
    for (int j = 0; j < N_OUT; ++j)
      for (int lane = 0; lane < left; ++lane) {
        double* row = out[j] + (k + lane) * rows_out[j];
        for (int i = 0; i < rows_out[j]; ++i) row[i] = to[j][i].x[lane];
      }
  }
}

}  // namespace lanes

#define casadi_real lanes::Real
#define __STDC_VERSION__ 199901L  // CasADi's own fabs, fmin and so on branch where this is older
