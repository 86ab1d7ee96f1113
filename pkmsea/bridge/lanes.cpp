// One instruction set's lanes (see lanes.hpp). LANES is its name, LANES_WIDTH the doubles in one of its vectors.
//
// Nothing here may be an inline function of a library: the linker would keep one copy for all instruction sets.
#include "lanes.hpp"

#include <math.h>
#include <string.h>

namespace {

using lanes::Block;
using lanes::Handler;
using lanes::Kind;
using lanes::Step;

constexpr int WIDTH = LANES_WIDTH;
typedef double V __attribute__((vector_size(LANES_WIDTH * sizeof(double)), may_alias));
typedef double Loose __attribute__((vector_size(LANES_WIDTH * sizeof(double)), aligned(8), may_alias));
typedef long long I __attribute__((vector_size(LANES_WIDTH * sizeof(double)), may_alias));

inline V all(double x) { return x - V{}; }  // x - 0 keeps the sign of zero
inline V magnitude(V x) { return (V)((I)x & ~(I)all(-0.0)); }
inline bool any(I mask) {
  long long found = 0;
  for (int i = 0; i < WIDTH; ++i) found |= mask[i];
  return found != 0;
}

// An operand: a register of lanes, or one number for all of them.
template <bool UNIFORM>
struct Operand {
  const V *lane;
  Operand(const Block &block, int at) : lane((const V *)(block.registers + at)) {}
  V operator[](long i) const { return lane[i]; }
};
template <>
struct Operand<true> {
  V number;
  Operand(const Block &block, int at) : number(all(block.uniform[at])) {}
  V operator[](long) const { return number; }
};

inline V *result(const Block &block, int at) { return (V *)(block.registers + at); }

struct Add { static V of(V a, V b) { return a + b; } };
struct Sub { static V of(V a, V b) { return a - b; } };
struct Mul { static V of(V a, V b) { return a * b; } };
struct Div { static V of(V a, V b) { return a / b; } };
struct Neg { static V of(V a) { return -a; } };
struct Square { static V of(V a) { return a * a; } };
struct Twice { static V of(V a) { return all(2.0) * a; } };
struct Inverse { static V of(V a) { return all(1.0) / a; } };
struct Magnitude { static V of(V a) { return magnitude(a); } };
struct Root {
  static V of(V a) {
    V r;
    for (int i = 0; i < WIDTH; ++i) r[i] = __builtin_sqrt(a[i]);
    return r;
  }
};
struct MulAdd { static V of(V a, V b, V c) { return a * b + c; } };
struct MulSub { static V of(V a, V b, V c) { return a * b - c; } };
struct SubMul { static V of(V a, V b, V c) { return c - a * b; } };
struct DotAdd { static V of(V a, V b, V c, V d) { return a * b + c * d; } };
struct DotSub { static V of(V a, V b, V c, V d) { return a * b - c * d; } };

template <class F>
void unary(const Step &s, const Block &block) {
  const Operand<false> a(block, s.a);
  V *o = result(block, s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) o[i] = F::of(a[i]);
}

template <class F, bool UA, bool UB>
void binary(const Step &s, const Block &block) {
  const Operand<UA> a(block, s.a);
  const Operand<UB> b(block, s.b);
  V *o = result(block, s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) o[i] = F::of(a[i], b[i]);
}

template <class F, bool UA, bool UC>
void ternary(const Step &s, const Block &block) {
  const Operand<UA> a(block, s.a);
  const Operand<false> b(block, s.b);
  const Operand<UC> c(block, s.c);
  V *o = result(block, s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) o[i] = F::of(a[i], b[i], c[i]);
}

template <class F, bool UA, bool UC>
void quaternary(const Step &s, const Block &block) {
  const Operand<UA> a(block, s.a);
  const Operand<false> b(block, s.b);
  const Operand<UC> c(block, s.c);
  const Operand<false> d(block, s.d);
  V *o = result(block, s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) o[i] = F::of(a[i], b[i], c[i], d[i]);
}

// Sine and cosine with an error below 1 ulp: x less a multiple n of pi/2, the remainder as a sum of two doubles (Cody and
// Waite, pi/2 in parts of 33 bits whose products with n are exact), then minimax polynomials on [-pi/4, pi/4]. The
// constants are those of Sun's fdlibm. Larger arguments, infinities and NaN are left to libm.
constexpr double REDUCIBLE = 1e6;
constexpr double ROUNDER = 6755399441055744.0;  // 1.5 * 2^52: adding it leaves an integer in the lowest bits

inline V sine_polynomial(V x, V tail) {
  const V z = x * x, v = z * x;
  const V r = 8.33333333332248946124e-03 +
              z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 +
              z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
  return x - ((z * (0.5 * tail - v * r) - tail) - v * -1.66666666666666324348e-01);
}

inline V cosine_polynomial(V x, V tail) {
  const V z = x * x;
  const V r = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 +
              z * (2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 +
              z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))));
  const V half = 0.5 * z, w = 1.0 - half;
  return w + (((1.0 - w) - half) + (z * r - x * tail));
}

template <bool SINE, bool COSINE>
void trigonometric(const Step &s, const Block &block) {
  const V *x = (const V *)(block.registers + s.a);
  V *sine = result(block, s.out), *cosine = result(block, SINE ? s.out2 : s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) {
    const V given = x[i];
    const V rounded = given * 6.36619772367581382433e-01 + ROUNDER;
    const V quarter = rounded - ROUNDER;
    const I count = (I)rounded;
    const V r = given - quarter * 1.57079632673412561417e+00;
    const V w = quarter * 6.07710050630396597660e-11;
    const V d = r - w, back = d - r;
    const V lost = (r - (d - back)) - (w + back);  // of r - w, exactly
    const V rest = quarter * 2.02226624879595063154e-21 - lost;
    const V head = d - rest, tail = (d - head) - rest;
    const V odd = sine_polynomial(head, tail), even = cosine_polynomial(head, tail);
    const I swapped = (count & 1) == 1;
    const I beyond = !(magnitude(given) <= REDUCIBLE);
    if (SINE) {
      const V value = swapped ? even : odd;
      sine[i] = (V)((I)value ^ ((count & 2) << 62));
    }
    if (COSINE) {
      const V value = swapped ? odd : even;
      cosine[i] = (V)((I)value ^ (((count + 1) & 2) << 62));
    }
    if (any(beyond))
      for (int lane = 0; lane < WIDTH; ++lane)
        if (beyond[lane]) {
          if (SINE) sine[i][lane] = sin(given[lane]);
          if (COSINE) cosine[i][lane] = cos(given[lane]);
        }
  }
}

// exp with an error below 1 ulp: 2^k e^r with |r| <= ln 2 / 2 and a rational minimax approximation (fdlibm's constants).
void exponential(const Step &s, const Block &block) {
  const V *x = (const V *)(block.registers + s.a);
  V *o = result(block, s.out);
  for (long i = 0, n = block.width / WIDTH; i < n; ++i) {
    const V given = x[i];
    const V rounded = given * 1.44269504088896338700e+00 + ROUNDER;
    const V k = rounded - ROUNDER;
    const V high = given - k * 6.93147180369123816490e-01, low = k * 1.90821492927058770002e-10;
    const V r = high - low, t = r * r;
    const V c = r - t * (1.66666666666666019037e-01 + t * (-2.77777777770155933842e-03 +
                t * (6.61375632143793436117e-05 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))));
    const V value = 1.0 - ((low - (r * c) / (2.0 - c)) - high);
    const I beyond = !(magnitude(given) <= 700.0);
    o[i] = (V)((I)value + (((I)rounded) << 52));
    if (any(beyond))
      for (int lane = 0; lane < WIDTH; ++lane)
        if (beyond[lane]) o[i][lane] = exp(given[lane]);
  }
}

void call(const Step &s, const Block &block) {
  const double *a = s.uniform & lanes::A ? block.uniform + s.a : block.registers + s.a;
  const double *b = s.uniform & lanes::B ? block.uniform + s.b : block.registers + s.b;
  const long step_a = s.uniform & lanes::A ? 0 : 1, step_b = s.uniform & lanes::B ? 0 : 1;
  double *o = block.registers + s.out;
  for (long i = 0; i < block.width; ++i) o[i] = s.scalar(a[i * step_a], b[i * step_b]);
}

void load(const Step &s, const Block &block) {
  const double *row = block.in[s.a] + s.b * block.instants + block.first;
  double *o = block.registers + s.out;
  memcpy(o, row, block.count * sizeof(double));
  for (long i = block.count; i < block.width; ++i) o[i] = row[block.count - 1];
}

void store(const Step &s, const Block &block) {
  double *row = block.out[s.out] + s.b * block.instants + block.first;
  if (s.uniform & lanes::A)
    for (long i = 0; i < block.count; ++i) row[i] = block.uniform[s.a];
  else
    memcpy(row, block.registers + s.a, block.count * sizeof(double));
}

template <class F>
Handler binary_of(int uniform) {
  if (uniform == lanes::NONE) return binary<F, false, false>;
  if (uniform == lanes::A) return binary<F, true, false>;
  return uniform == lanes::B ? binary<F, false, true> : nullptr;
}

template <class F>
Handler ternary_of(int uniform) {
  if (uniform == lanes::NONE) return ternary<F, false, false>;
  if (uniform == lanes::A) return ternary<F, true, false>;
  if (uniform == lanes::C) return ternary<F, false, true>;
  return uniform == (lanes::A | lanes::C) ? ternary<F, true, true> : nullptr;
}

template <class F>
Handler quaternary_of(int uniform) {
  if (uniform == lanes::NONE) return quaternary<F, false, false>;
  if (uniform == lanes::A) return quaternary<F, true, false>;
  if (uniform == lanes::C) return quaternary<F, false, true>;
  return uniform == (lanes::A | lanes::C) ? quaternary<F, true, true> : nullptr;
}

Handler handler(Kind kind, int uniform) {
  switch (kind) {
    case Kind::ADD: return binary_of<Add>(uniform);
    case Kind::SUB: return binary_of<Sub>(uniform);
    case Kind::MUL: return binary_of<Mul>(uniform);
    case Kind::DIV: return binary_of<Div>(uniform);
    case Kind::MUL_ADD: return ternary_of<MulAdd>(uniform);
    case Kind::MUL_SUB: return ternary_of<MulSub>(uniform);
    case Kind::SUB_MUL: return ternary_of<SubMul>(uniform);
    case Kind::DOT_ADD: return quaternary_of<DotAdd>(uniform);
    case Kind::DOT_SUB: return quaternary_of<DotSub>(uniform);
    case Kind::CALL: return call;
    case Kind::STORE: return store;
    default: break;
  }
  if (uniform) return nullptr;
  switch (kind) {
    case Kind::NEG: return unary<Neg>;
    case Kind::SQ: return unary<Square>;
    case Kind::TWICE: return unary<Twice>;
    case Kind::INV: return unary<Inverse>;
    case Kind::SQRT: return unary<Root>;
    case Kind::FABS: return unary<Magnitude>;
    case Kind::SIN: return trigonometric<true, false>;
    case Kind::COS: return trigonometric<false, true>;
    case Kind::SINCOS: return trigonometric<true, true>;
    case Kind::EXP: return exponential;
    case Kind::LOAD: return load;
    default: return nullptr;
  }
}

// Copies rows between an array (rows, instants) and vectors; lanes beyond the last instant repeat it.
inline V gather(const double *row, long left) {
  if (left >= WIDTH) return *(const Loose *)row;
  V x;
  for (int i = 0; i < WIDTH; ++i) x[i] = row[i < left ? i : left - 1];
  return x;
}

inline void scatter(V x, double *row, long left) {
  if (left >= WIDTH) {
    *(Loose *)row = x;
    return;
  }
  for (long i = 0; i < left; ++i) row[i] = x[i];
}

inline void exchange(V &x, V &y, I where) {
  const V t = x;
  x = where ? y : x;
  y = where ? t : y;
}

void factor(int n, double *matrix, double *pivots, double *sign, long first, long count, long instants, double *work) {
  V *m = (V *)work;  // column after column
  for (long k = first; k < first + count; k += WIDTH) {
    const long left = first + count - k;
    for (int e = 0; e < n * n; ++e) m[e] = gather(matrix + e * instants + k, left);
    V parity = all(1.0);
    for (int j = 0; j < n; ++j) {
      V largest = magnitude(m[j * n + j]), at = all(j);
      for (int i = j + 1; i < n; ++i) {
        const V size = magnitude(m[j * n + i]);
        const I larger = size > largest;
        largest = larger ? size : largest;
        at = larger ? all(i) : at;
      }
      for (int i = j + 1; i < n; ++i) {
        const I here = at == all(i);
        if (!any(here)) continue;
        for (int l = 0; l < n; ++l) exchange(m[l * n + j], m[l * n + i], here);
        parity = here ? -parity : parity;
      }
      scatter(at, pivots + j * instants + k, left);
      const V pivot = m[j * n + j];
      parity = pivot < 0.0 ? -parity : parity;
      parity = pivot == 0.0 ? V{} : parity;
      for (int i = j + 1; i < n; ++i) m[j * n + i] /= pivot;
      for (int l = j + 1; l < n; ++l)
        for (int i = j + 1; i < n; ++i) m[l * n + i] -= m[j * n + i] * m[l * n + j];
    }
    for (int e = 0; e < n * n; ++e) scatter(m[e], matrix + e * instants + k, left);
    scatter(parity, sign + k, left);
  }
}

void solve(int n, int columns, bool transposed, const double *factors, const double *pivots, double *right, long first,
           long count, long instants, double *work) {
  V *m = (V *)work, *p = m + n * n, *x = p + n;
  for (long k = first; k < first + count; k += WIDTH) {
    const long left = first + count - k;
    for (int e = 0; e < n * n; ++e) m[e] = gather(factors + e * instants + k, left);
    for (int j = 0; j < n; ++j) p[j] = gather(pivots + j * instants + k, left);
    for (int column = 0; column < columns; ++column) {
      double *own = right + (long)column * n * instants + k;
      for (int i = 0; i < n; ++i) x[i] = gather(own + i * instants, left);
      if (!transposed) {
        for (int j = 0; j < n; ++j)
          for (int i = j + 1; i < n; ++i) {
            const I here = p[j] == all(i);
            if (any(here)) exchange(x[j], x[i], here);
          }
        for (int j = 0; j < n; ++j)
          for (int i = j + 1; i < n; ++i) x[i] -= m[j * n + i] * x[j];
        for (int j = n - 1; j >= 0; --j) {
          x[j] /= m[j * n + j];
          for (int i = 0; i < j; ++i) x[i] -= m[j * n + i] * x[j];
        }
      } else {
        for (int j = 0; j < n; ++j) {
          for (int i = 0; i < j; ++i) x[j] -= m[j * n + i] * x[i];
          x[j] /= m[j * n + j];
        }
        for (int j = n - 1; j >= 0; --j)
          for (int i = j + 1; i < n; ++i) x[j] -= m[j * n + i] * x[i];
        for (int j = n - 1; j >= 0; --j)
          for (int i = j + 1; i < n; ++i) {
            const I here = p[j] == all(i);
            if (any(here)) exchange(x[j], x[i], here);
          }
      }
      for (int i = 0; i < n; ++i) scatter(x[i], own + i * instants, left);
    }
  }
}

// ROWS rows and VECTORS vectors of C stay in registers.
template <int ROWS, int VECTORS>
inline void tile(int k, const double *A, long a, const double *B, long b, double *C, long c) {
  V sum[ROWS][VECTORS];
  for (int i = 0; i < ROWS; ++i)
    for (int v = 0; v < VECTORS; ++v) sum[i][v] = ((const Loose *)(C + i * c))[v];
  for (int l = 0; l < k; ++l, A += a, B += b)
    for (int v = 0; v < VECTORS; ++v) {
      const V right = ((const Loose *)B)[v];
      for (int i = 0; i < ROWS; ++i) sum[i][v] += all(A[i]) * right;
    }
  for (int i = 0; i < ROWS; ++i)
    for (int v = 0; v < VECTORS; ++v) ((Loose *)(C + i * c))[v] = sum[i][v];
}

template <int ROWS>
inline void rows_of_tiles(int k, int n, const double *A, long a, const double *B, long b, double *C, long c, int at) {
  for (; at + 3 * WIDTH <= n; at += 3 * WIDTH) tile<ROWS, 3>(k, A, a, B + at, b, C + at, c);
  for (; at + 2 * WIDTH <= n; at += 2 * WIDTH) tile<ROWS, 2>(k, A, a, B + at, b, C + at, c);
  for (; at < n; at += WIDTH) tile<ROWS, 1>(k, A, a, B + at, b, C + at, c);
}

void accumulate(int k, int m, int n, const double *A, long a, const double *B, long b, double *C, long c, bool upper) {
  const auto first = [upper](int row) { return upper ? row / lanes::WIDEST * lanes::WIDEST : 0; };
  int i = 0;
  for (; i + 4 <= m; i += 4) rows_of_tiles<4>(k, n, A + i, a, B, b, C + i * c, c, first(i));
  for (; i < m; ++i) rows_of_tiles<1>(k, n, A + i, a, B, b, C + i * c, c, first(i));
}

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

}  // namespace

namespace lanes {
extern const Table LANES;
const Table LANES = {TEXT(LANES), handler, factor, solve, accumulate};
}  // namespace lanes
