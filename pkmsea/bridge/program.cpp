#include "program.hpp"

#include <casadi/core/calculus.hpp>

#include <algorithm>
#include <cstring>
#include <map>
#include <tuple>
#include <unordered_map>

namespace machine {

using lanes::Kind;

namespace {

template <casadi_int OP>
double scalar(double x, double y) {
  double f;
  casadi::BinaryOperation<OP>::fcn(x, y, f);
  return f;
}

template <casadi_int OP>
double scalar_unary(double x, double) {
  double f;
  casadi::UnaryOperation<OP>::fcn(x, f);
  return f;
}

// CasADi's own scalar operation, for those that have no vector form here.
lanes::Scalar scalar_of(casadi_int op) {
  using namespace casadi;
#define UNARY(OP) case OP: return scalar_unary<OP>
#define BINARY(OP) case OP: return scalar<OP>
  switch (op) {
    UNARY(OP_LOG); UNARY(OP_TAN); UNARY(OP_ASIN); UNARY(OP_ACOS); UNARY(OP_ATAN); UNARY(OP_NOT); UNARY(OP_FLOOR);
    UNARY(OP_CEIL); UNARY(OP_SIGN); UNARY(OP_ERF); UNARY(OP_SINH); UNARY(OP_COSH); UNARY(OP_TANH); UNARY(OP_ASINH);
    UNARY(OP_ACOSH); UNARY(OP_ATANH); UNARY(OP_ERFINV); UNARY(OP_LOG1P); UNARY(OP_EXPM1);
    BINARY(OP_POW); BINARY(OP_CONSTPOW); BINARY(OP_LT); BINARY(OP_LE); BINARY(OP_EQ); BINARY(OP_NE); BINARY(OP_AND);
    BINARY(OP_OR); BINARY(OP_FMOD); BINARY(OP_COPYSIGN); BINARY(OP_IF_ELSE_ZERO); BINARY(OP_FMIN); BINARY(OP_FMAX);
    BINARY(OP_ATAN2); BINARY(OP_HYPOT); BINARY(OP_REMAINDER);
    default: return nullptr;
  }
#undef UNARY
#undef BINARY
}

bool kind_of(casadi_int op, Kind &kind) {
  using namespace casadi;
  switch (op) {
    case OP_ADD: kind = Kind::ADD; return true;
    case OP_SUB: kind = Kind::SUB; return true;
    case OP_MUL: kind = Kind::MUL; return true;
    case OP_DIV: kind = Kind::DIV; return true;
    case OP_NEG: kind = Kind::NEG; return true;
    case OP_SQ: kind = Kind::SQ; return true;
    case OP_TWICE: kind = Kind::TWICE; return true;
    case OP_INV: kind = Kind::INV; return true;
    case OP_SQRT: kind = Kind::SQRT; return true;
    case OP_FABS: kind = Kind::FABS; return true;
    case OP_SIN: kind = Kind::SIN; return true;
    case OP_COS: kind = Kind::COS; return true;
    case OP_EXP: kind = Kind::EXP; return true;
    default: return false;
  }
}

}  // namespace

// A value: constant, input, or an operation on other values; `late` marks one that its only user computes.
struct Program::Node {
  enum Type { CONSTANT, INPUT, OPERATION } type;
  Kind kind = Kind::ADD;
  int a = -1, b = -1;
  lanes::Scalar scalar = nullptr;
  double number = 0;
  bool uniform = false;
  int uses = 0;
  bool late = false;
  int partner = -1;  // the cosine that a sine computes too, and the other way round
  int place = -1;    // register or uniform number
};

struct Program::Builder {
  Program &program;
  std::vector<Node> nodes;
  std::vector<std::tuple<int, int, int>> outputs;  // output, row, node

  explicit Builder(Program &program) : program(program) {}

  // ---- reading: one node for each different value ----

  struct Key {
    int type, kind, a, b;
    lanes::Scalar scalar;
    std::uint64_t bits;  // of a constant: 0 and -0 differ
    bool operator==(const Key &other) const {
      return type == other.type && kind == other.kind && a == other.a && b == other.b && scalar == other.scalar &&
             bits == other.bits;
    }
  };
  struct Hash {
    std::size_t operator()(const Key &key) const {
      std::size_t result = std::size_t(key.bits) ^ reinterpret_cast<std::size_t>(key.scalar);
      for (int part : {key.type, key.kind, key.a, key.b}) result = result * 0x9e3779b97f4a7c15u + std::size_t(part);
      return result ^ (result >> 32);
    }
  };
  std::unordered_map<Key, int, Hash> known;

  int add(const Node &node) {
    Key key{int(node.type), int(node.kind), node.a, node.b, node.scalar, 0};
    std::memcpy(&key.bits, &node.number, sizeof key.bits);
    const auto [place, fresh] = known.emplace(key, int(nodes.size()));
    if (fresh) nodes.push_back(node);
    return place->second;
  }

  void read(const casadi::Function &f) {
    std::vector<int> work(f.sz_w() + 1, -1);
    const auto at = [&](casadi_int slot) -> int & {
      if (std::size_t(slot) >= work.size()) work.resize(slot + 1, -1);
      return work[slot];
    };
    program.instructions = f.n_instructions();
    for (casadi_int k = 0; k < f.n_instructions(); ++k) {
      const auto op = f.instruction_id(k);
      if (op == casadi::OP_CONST) {
        Node node{Node::CONSTANT};
        node.number = f.instruction_constant(k);
        node.uniform = true;
        at(f.instruction_output(k)[0]) = add(node);
        continue;
      }
      const auto in = f.instruction_input(k), out = f.instruction_output(k);
      if (op == casadi::OP_INPUT) {
        Node node{Node::INPUT};
        node.a = int(in[0]);
        node.b = int(in[1]);
        node.uniform = program.uniform_in[in[0]];
        at(out[0]) = add(node);
      } else if (op == casadi::OP_OUTPUT) {
        outputs.emplace_back(int(out[0]), int(out[1]), at(in[0]));
      } else if (op == casadi::OP_ASSIGN || op == casadi::OP_LIFT) {
        at(out[0]) = at(in[0]);
      } else {
        Node node{Node::OPERATION};
        if (!kind_of(op, node.kind)) {
          node.kind = Kind::CALL;
          node.scalar = scalar_of(op);
          if (!node.scalar)
            throw Unknown("instruction " + std::to_string(k) + " of the Function '" + f.name() +
                          "' is operation " + std::to_string(op) + " of CasADi's, which the vector machine does not have");
        }
        node.a = at(in[0]);
        node.b = in.size() > 1 && casadi::casadi_math<double>::is_binary(op) ? at(in[1]) : node.a;
        node.uniform = nodes[node.a].uniform && nodes[node.b].uniform;
        at(out[0]) = add(node);
      }
    }
  }

  // ---- what is used, and how often ----

  void count() {
    for (const auto &[output, row, node] : outputs) ++nodes[node].uses;
    for (int i = int(nodes.size()) - 1; i >= 0; --i) {
      const Node &node = nodes[i];
      if (node.type != Node::OPERATION || !node.uses) continue;
      ++nodes[node.a].uses;
      if (node.b != node.a) ++nodes[node.b].uses;
    }
  }

  bool lane(int i) const { return !nodes[i].uniform; }

  // A product that is used once, by a sum, is computed in the sum.
  void fuse() {
    const auto product = [&](int i) {
      const Node &node = nodes[i];
      return node.type == Node::OPERATION && lane(i) && node.uses == 1 && (node.kind == Kind::MUL || node.kind == Kind::SQ);
    };
    for (int i = 0; i < int(nodes.size()); ++i) {
      const Node &node = nodes[i];
      const bool sum = node.type == Node::OPERATION && (node.kind == Kind::ADD || node.kind == Kind::SUB);
      if (!sum || !node.uses || !lane(i) || node.a == node.b) continue;
      if (product(node.a)) nodes[node.a].late = true;
      if (product(node.b)) nodes[node.b].late = true;
    }
    std::map<int, int> sines;
    for (int i = 0; i < int(nodes.size()); ++i)
      if (nodes[i].kind == Kind::SIN && lane(i) && nodes[i].uses && nodes[i].type == Node::OPERATION) sines[nodes[i].a] = i;
    for (int i = 0; i < int(nodes.size()); ++i) {
      if (nodes[i].kind != Kind::COS || !lane(i) || !nodes[i].uses || nodes[i].type != Node::OPERATION) continue;
      const auto sine = sines.find(nodes[i].a);
      if (sine == sines.end()) continue;
      nodes[i].partner = sine->second;
      nodes[sine->second].partner = i;
    }
  }

  // ---- writing: registers are reused as soon as their value is not needed any more ----

  std::vector<int> pending, free_registers;
  int highest = 0, uniforms = 0;
  std::vector<char> done;

  int fresh() {
    if (free_registers.empty()) return highest++;
    const int place = free_registers.back();
    free_registers.pop_back();
    return place;
  }

  void used(int i) {
    if (!lane(i)) return;
    if (nodes[i].late) {
      used(nodes[i].a);
      if (nodes[i].b != nodes[i].a) used(nodes[i].b);
      return;
    }
    if (--pending[i] == 0) free_registers.push_back(nodes[i].place);
  }

  // The operand's place; loads an input at its first use.
  int operand(int i) {
    Node &node = nodes[i];
    if (node.place < 0 && node.type == Node::INPUT && lane(i)) {
      Instruction load{Kind::LOAD};
      load.a = node.a;
      load.b = node.b;
      load.out = node.place = fresh();
      program.steps_.push_back(load);
    }
    return node.place;
  }

  void factors(int i, int &x, int &y) {  // of a product, the uniform one first
    x = nodes[i].a;
    y = nodes[i].kind == Kind::SQ ? x : nodes[i].b;
    if (!lane(y)) std::swap(x, y);
  }

  void emit(int i) {
    Node &node = nodes[i];
    Instruction step{node.kind};
    step.scalar = node.scalar;
    const bool sum = node.kind == Kind::ADD || node.kind == Kind::SUB;
    const bool first = sum && nodes[node.a].late, second = sum && nodes[node.b].late && node.a != node.b;
    if (first || second) {
      int x, y, z, w = -1;
      if (first && second) {
        step.kind = node.kind == Kind::ADD ? Kind::DOT_ADD : Kind::DOT_SUB;
        factors(node.a, x, y);
        factors(node.b, z, w);
      } else {
        step.kind = node.kind == Kind::ADD ? Kind::MUL_ADD : first ? Kind::MUL_SUB : Kind::SUB_MUL;
        factors(first ? node.a : node.b, x, y);
        z = first ? node.b : node.a;
      }
      step.a = operand(x);
      step.b = operand(y);
      step.c = operand(z);
      if (w >= 0) step.d = operand(w);
      step.uniform = (lane(x) ? 0 : lanes::A) | (lane(z) ? 0 : lanes::C);
    } else {
      step.a = operand(node.a);
      step.b = operand(node.b);
      step.uniform = (lane(node.a) ? 0 : lanes::A) | (lane(node.b) ? 0 : lanes::B);
    }
    used(node.a);
    if (node.b != node.a) used(node.b);
    if (node.partner >= 0) {
      Node &other = nodes[node.partner];
      used(other.a);
      step.kind = Kind::SINCOS;
      other.place = fresh();
      done[node.partner] = true;
    }
    node.place = fresh();
    step.out = node.place;
    if (node.partner >= 0) {
      step.out2 = nodes[node.partner].place;
      if (node.kind == Kind::COS) std::swap(step.out, step.out2);
    }
    program.steps_.push_back(step);
  }

  void write() {
    pending.resize(nodes.size());
    done.assign(nodes.size(), false);
    for (std::size_t i = 0; i < nodes.size(); ++i) pending[i] = nodes[i].uses;
    // a late product's factors are used where the sum is
    std::vector<std::vector<std::pair<int, int>>> stores(nodes.size());
    for (const auto &[output, row, node] : outputs) stores[node].emplace_back(output, row);
    const auto finish = [&](int i) {
      for (const auto &[output, row] : stores[i]) {
        Instruction store{Kind::STORE};
        store.a = operand(i);
        store.b = row;
        store.out = output;
        store.uniform = lane(i) ? 0 : lanes::A;
        program.steps_.push_back(store);
        used(i);
      }
    };
    for (int i = 0; i < int(nodes.size()); ++i) {
      Node &node = nodes[i];
      if (!node.uses) continue;
      if (!lane(i)) {
        node.place = uniforms++;
        program.constants_.push_back(node.type == Node::CONSTANT ? node.number : 0.0);
        if (node.type == Node::INPUT) program.uniform_loads_.push_back({node.place, {node.a, node.b}});
        if (node.type == Node::OPERATION) {
          Instruction step{node.kind};
          step.a = nodes[node.a].place;
          step.b = nodes[node.b].place;
          step.out = node.place;
          step.scalar = node.scalar;
          program.prelude_.push_back(step);
        }
        finish(i);
      } else if (node.type == Node::INPUT) {
        finish(i);
      } else if (!node.late && !done[i]) {
        emit(i);
        finish(i);
        if (node.partner >= 0) finish(node.partner);
      }
    }
    program.registers = highest;
    program.uniform_size = uniforms;
  }
};

Program::Program(const casadi::Function &f, const std::vector<bool> &uniform) : name(f.name()), uniform_in(uniform) {
  if (!f.is_a("SXFunction"))
    throw Unknown("the Function '" + f.name() + "' is no SX Function, so it has no instructions on numbers; expand() it");
  for (casadi_int i = 0; i < f.n_in(); ++i) rows_in.push_back(f.nnz_in(i));
  for (casadi_int i = 0; i < f.n_out(); ++i) rows_out.push_back(f.nnz_out(i));
  uniform_in.resize(rows_in.size());
  Builder builder(*this);
  builder.read(f);
  builder.count();
  builder.fuse();
  builder.write();
}

void Program::prepare(const lanes::Table &table, const double *const *in, double *uniform) const {
  std::copy(constants_.begin(), constants_.end(), uniform);
  for (const auto &[place, from] : uniform_loads_) uniform[place] = in[from.first][from.second];
  if (prelude_.empty()) return;
  // the same handlers as for lanes, so that a number does not depend on whether it is uniform
  constexpr long WIDTH = lanes::WIDEST;
  std::unique_ptr<double[]> memory(new double[(uniform_size + 1) * WIDTH]);
  double *registers = memory.get();
  registers += (64 - reinterpret_cast<std::uintptr_t>(registers) % 64) % 64 / sizeof(double);
  for (long i = 0; i < uniform_size; ++i) std::fill_n(registers + i * WIDTH, WIDTH, uniform[i]);
  const lanes::Block block{registers, uniform, nullptr, nullptr, 0, WIDTH, WIDTH, WIDTH};
  for (const Instruction &x : prelude_) {
    const lanes::Step step{table.handler(x.kind, 0), int(x.out * WIDTH), 0, int(x.a * WIDTH), int(x.b * WIDTH), 0, 0, 0,
                           x.scalar};
    step.run(step, block);
  }
  for (long i = 0; i < uniform_size; ++i) uniform[i] = registers[i * WIDTH];
}

std::vector<lanes::Step> Program::bound(const lanes::Table &table, long width) const {
  std::vector<lanes::Step> steps;
  steps.reserve(steps_.size());
  const auto place = [&](int at, bool uniform) { return uniform ? at : int(at * width); };
  for (const Instruction &x : steps_) {
    const bool moves = x.kind == Kind::LOAD || x.kind == Kind::STORE;
    lanes::Step step{table.handler(x.kind, x.uniform)};
    step.uniform = x.uniform;
    step.scalar = x.scalar;
    step.out = x.kind == Kind::STORE ? x.out : int(x.out * width);
    step.out2 = int(x.out2 * width);
    step.a = x.kind == Kind::LOAD ? x.a : place(x.a, x.uniform & lanes::A);
    step.b = moves ? x.b : place(x.b, x.uniform & lanes::B);
    step.c = place(x.c, x.uniform & lanes::C);
    step.d = int(x.d * width);
    steps.push_back(step);
  }
  return steps;
}

void Program::run(const std::vector<lanes::Step> &steps, const lanes::Block &block) const {
  for (const lanes::Step &step : steps) step.run(step, block);
}

}  // namespace machine
