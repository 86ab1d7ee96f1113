// A CasADi SX Function as a program of the vector machine: its instructions, each done for a block of instants at once.
#pragma once

#include <casadi/core/function.hpp>

#include <memory>
#include <string>
#include <vector>

#include "lanes.hpp"

namespace machine {

// The nonzeros of input i are an array (rows_in[i], instants), or (rows_in[i],) where it is uniform: the same at all
// instants. Those of output i are an array (rows_out[i], instants).
//
// Built from the Function's instructions: equal ones are merged, what no output needs is dropped, what depends on uniform
// inputs and constants alone runs once a call, products go into the sums that use them, and a sine and cosine of one
// angle into one instruction. None of that changes a bit of a result.
class Program {
 public:
  Program(const casadi::Function &function, const std::vector<bool> &uniform);

  // Evaluate the uniform part; `uniform` receives its numbers (uniform_size), and `in` are all inputs.
  void prepare(const lanes::Table &table, const double *const *in, double *uniform) const;
  // Evaluate a block; `registers` has registers() times `width` doubles.
  void run(const std::vector<lanes::Step> &steps, const lanes::Block &block) const;
  // The steps for blocks of `width` lanes.
  std::vector<lanes::Step> bound(const lanes::Table &table, long width) const;

  std::string name;
  std::vector<long> rows_in, rows_out;
  std::vector<bool> uniform_in;
  long instructions = 0;  // of the Function
  long registers = 0, uniform_size = 0;
  long steps() const { return long(steps_.size()); }

 private:
  struct Instruction {
    lanes::Kind kind;
    int out = 0, out2 = 0, a = 0, b = 0, c = 0, d = 0;
    int uniform = 0;
    lanes::Scalar scalar = nullptr;
  };
  struct Node;
  struct Builder;

  std::vector<Instruction> steps_, prelude_;
  std::vector<double> constants_;  // of the uniform numbers, at their places
  std::vector<std::pair<int, std::pair<int, int>>> uniform_loads_;  // place, (input, row)
};

// Raised where a Function has an instruction that the machine does not know.
struct Unknown : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace machine
