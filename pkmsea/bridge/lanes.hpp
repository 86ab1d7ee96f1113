// The lanes of the vector machine: what one instruction does to a block of instants.
//
// lanes.cpp is compiled once for every instruction set; `best()` picks the widest one that this processor has. All of
// them do the same IEEE operations in the same order, so the choice does not change a single bit of a result.
#pragma once

namespace lanes {

constexpr int WIDEST = 8;  // doubles in the widest vector; blocks and registers are multiples of it

enum class Kind {
  ADD, SUB, MUL, DIV, NEG, SQ, TWICE, INV, SQRT, FABS, SIN, COS, SINCOS, EXP,
  MUL_ADD,  // a b + c
  MUL_SUB,  // a b - c
  SUB_MUL,  // c - a b
  DOT_ADD,  // a b + c d
  DOT_SUB,  // a b - c d
  CALL,     // scalar(a, b), lane by lane
  LOAD,     // row b of input a
  STORE     // register a into row b of output `out`
};

// Which of the operands a, b, c are uniform: one number for all lanes.
enum Uniform { NONE = 0, A = 1, B = 2, C = 4 };

struct Block {
  double *registers;
  const double *uniform;
  const double *const *in;  // arrays (rows, instants)
  double *const *out;
  long first, count, instants;  // the block's first instant, how many it has, and all of them
  long width;                   // count, rounded up to whole vectors
};

struct Step;
using Handler = void (*)(const Step &, const Block &);
using Scalar = double (*)(double, double);

struct Step {
  Handler run;
  int out, out2;   // offsets into the registers
  int a, b, c, d;  // likewise, or into the uniform numbers
  int uniform;
  Scalar scalar;
};

struct Table {
  const char *name;
  Handler (*handler)(Kind, int uniform);  // null where there is none for these operands
  // Matrices (n n, instants), columns one after the other, become L and U of a row-pivoted factorisation; pivots (n,
  // instants), sign of the determinant (instants).
  void (*factor)(int n, double *matrix, double *pivots, double *sign, long first, long count, long instants, double *work);
  // Right-hand sides (n columns, instants) become solutions, of the transposed matrices if so wished.
  void (*solve)(int n, int columns, bool transposed, const double *factors, const double *pivots, double *right,
                long first, long count, long instants, double *work);
  // C += A^T B with rows of A, B, C of `a`, `b`, `c` doubles: k rows of A and B, m of C, n columns of B and C, a multiple
  // of WIDEST; with `upper`, only what lies in whole vectors on and right of C's diagonal.
  void (*accumulate)(int k, int m, int n, const double *A, long a, const double *B, long b, double *C, long c, bool upper);
};

long work_size(int n, int columns);  // doubles that factor and solve need

const Table &best();
const Table *named(const char *name);  // null where this processor or this build lacks it
const char *const *names();            // of all that can be used here, ended by null

}  // namespace lanes
