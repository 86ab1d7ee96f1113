// The vector machine for Python: programs, and pipelines of programs and linear systems on arrays (rows, instants).
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "array.hpp"
#include "program.hpp"

using machine::Program;

namespace {

constexpr long REGISTER_BYTES = 1536 * 1024;  // of a block: fewer, longer blocks won against registers in the first cache
constexpr long LONGEST = 128;                              // lanes of a block

// Steps that are done one after the other for all instants, block by block.
class Pipeline {
 public:
  Pipeline(const Pipeline &) = delete;
  Pipeline(long instants, const std::string &lanes) : instants_(instants) {
    table_ = lanes.empty() ? &lanes::best() : lanes::named(lanes.c_str());
    if (!table_) throw nb::value_error(("there are no lanes '" + lanes + "' here").c_str());
  }

  void call(const Program &program, std::vector<Array> in, std::vector<Array> out) {
    if (in.size() != program.rows_in.size() || out.size() != program.rows_out.size())
      throw nb::value_error(("'" + program.name + "' takes another number of arrays").c_str());
    Step step;
    step.program = &program;
    for (std::size_t i = 0; i < in.size(); ++i)
      step.in.push_back(pointer(in[i], program.rows_in[i], program.uniform_in[i] ? 1 : instants_, program.name));
    for (std::size_t i = 0; i < out.size(); ++i)
      step.out.push_back(pointer(out[i], program.rows_out[i], instants_, program.name));
    step.uniform.grow(program.uniform_size + 1);
    steps_.push_back(std::move(step));
    registers_ = std::max(registers_, program.registers);
  }

  void factor(long n, Array matrix, Array pivots, Array sign) {
    Step step;
    step.n = int(n);
    step.out = {pointer(matrix, n * n, instants_, "factor"), pointer(pivots, n, instants_, "factor"),
                pointer(sign, 1, instants_, "factor")};
    steps_.push_back(std::move(step));
    work_ = std::max(work_, lanes::work_size(int(n), 1));
  }

  void solve(long n, long columns, bool transposed, Array factors, Array pivots, Array right) {
    Step step;
    step.n = int(n);
    step.columns = int(columns);
    step.transposed = transposed;
    step.in = {pointer(factors, n * n, instants_, "solve"), pointer(pivots, n, instants_, "solve")};
    step.out = {pointer(right, n * columns, instants_, "solve")};
    steps_.push_back(std::move(step));
    work_ = std::max(work_, lanes::work_size(int(n), 1));
  }

  void run(int threads) {
    if (!width_) bind();
    const long blocks = (instants_ + width_ - 1) / width_;
    threads = int(std::max(1L, std::min<long>(threads, blocks)));
    while (int(memory_.size()) < threads) {
      memory_.emplace_back();
      memory_.back().grow(registers_ * width_ + work_);
    }
    for (Step &step : steps_)
      if (step.program) step.program->prepare(*table_, step.in.data(), step.uniform.begin);
    std::atomic<long> next{0};
    const auto work = [&](double *memory) {
      for (long block; (block = next++) < blocks;) run_block(block * width_, memory);
    };
    std::vector<std::thread> others;
    for (int i = 1; i < threads; ++i) others.emplace_back(work, memory_[i].begin);
    work(memory_[0].begin);
    for (std::thread &other : others) other.join();
  }

  // Newton's method at all instants at once: unknowns += step, which the pipeline computes with gap, until |gap| < near
  // before the last step. Fails where a step would be longer than `longest`, or after `iterations`.
  bool newton(Array unknowns, Array step, Array gap, double longest, double near, int iterations, int threads) {
    const double *s = step.data(), *g = gap.data();
    double *x = unknowns.data();
    for (int i = 0; i < iterations; ++i) {
      run(threads);
      bool close = true;
      for (std::size_t j = 0; j < step.size(); ++j)
        if (!(std::fabs(s[j]) < longest)) return false;
      for (std::size_t j = 0; j < step.size(); ++j) x[j] += s[j];
      for (std::size_t j = 0; j < gap.size(); ++j) close = close && std::fabs(g[j]) < near;
      if (close) return true;
    }
    return false;
  }

  const char *lanes() const { return table_->name; }
  long width() {
    if (!width_) bind();
    return width_;
  }

 private:
  struct Step {
    const Program *program = nullptr;  // none: a linear system, whose factors are made where `columns` is 0
    std::vector<const double *> in;
    std::vector<double *> out;
    Memory uniform;
    std::vector<lanes::Step> bound;
    int n = 0, columns = 0;
    bool transposed = false;
  };

  double *pointer(const Array &array, long rows, long instants, const std::string &who) {
    kept_.push_back(array);
    return numbers(array, rows, instants, who);
  }

  void bind() {
    const long most = std::max(registers_, 1L) * long(sizeof(double));
    long width = std::clamp(REGISTER_BYTES / most / lanes::WIDEST * lanes::WIDEST, long(lanes::WIDEST), LONGEST);
    const long blocks = (instants_ + width - 1) / width;
    width_ = ((instants_ + blocks - 1) / blocks + lanes::WIDEST - 1) / lanes::WIDEST * lanes::WIDEST;
    for (Step &step : steps_)
      if (step.program) step.bound = step.program->bound(*table_, width_);
  }

  void run_block(long first, double *memory) {
    const long count = std::min(width_, instants_ - first);
    const long width = (count + lanes::WIDEST - 1) / lanes::WIDEST * lanes::WIDEST;
    double *work = memory + registers_ * width_;
    for (const Step &step : steps_) {
      if (step.program)
        step.program->run(step.bound, {memory, step.uniform.begin, step.in.data(), step.out.data(), first, count,
                                       instants_, width});
      else if (step.columns)
        table_->solve(step.n, step.columns, step.transposed, step.in[0], step.in[1], step.out[0], first, count,
                      instants_, work);
      else
        table_->factor(step.n, step.out[0], step.out[1], step.out[2], first, count, instants_, work);
    }
  }

  long instants_, registers_ = 0, work_ = 0, width_ = 0;
  const lanes::Table *table_;
  std::vector<Step> steps_;
  std::vector<Memory> memory_;
  std::vector<Array> kept_;
};

std::vector<std::string> lanes_names() {
  std::vector<std::string> result;
  for (const char *const *name = lanes::names(); *name; ++name) result.emplace_back(*name);
  return result;
}

}  // namespace

void register_machine(nb::module_ &m) {
  nb::exception<machine::Unknown>(m, "UnknownInstruction", PyExc_ValueError);
  m.def("lanes", &lanes_names);
  nb::class_<Program>(m, "Program")
      .def("__init__", [](Program *self, const std::string &serialized, const std::vector<bool> &uniform) {
        new (self) Program(::casadi::Function::deserialize(serialized), uniform);
      })
      .def_ro("name", &Program::name)
      .def_ro("instructions", &Program::instructions)
      .def_ro("registers", &Program::registers)
      .def_prop_ro("steps", &Program::steps);
  nb::class_<Pipeline>(m, "Pipeline")
      .def(nb::init<long, const std::string &>())
      .def("call", &Pipeline::call, nb::keep_alive<1, 2>())
      .def("factor", &Pipeline::factor)
      .def("solve", &Pipeline::solve)
      .def("run", &Pipeline::run, nb::arg("threads") = 1, nb::call_guard<nb::gil_scoped_release>())
      .def("newton", &Pipeline::newton, nb::call_guard<nb::gil_scoped_release>())
      .def_prop_ro("lanes", &Pipeline::lanes)
      .def_prop_ro("width", &Pipeline::width);
}
