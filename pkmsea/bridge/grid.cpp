// From instants to a periodic grid: coefficients of a basis spread to the instants, differences in time, and derivatives
// of what the instants give gathered into gradient, Jacobian and Hessian of the coefficients.
//
// The grid is cut into cells of own samples with a halo on both sides; a cell depends on few local variables: L
// coefficients of each output, and the parameters. With w_k = E_k x_local the signals of an instant are s_k(w_k), and
// z_k holds rows of s, of its first and its second time derivative, by central differences on the periodic grid.
#include <algorithm>
#include <cstring>
#include <vector>

#include "array.hpp"
#include "lanes.hpp"

namespace {

constexpr int TOGETHER = 8;  // samples whose outer products are added at once

long padded(long n) { return (n + lanes::WIDEST - 1) / lanes::WIDEST * lanes::WIDEST; }

// Numbers (size, instants) instant by instant.
class ByInstant {
 public:
  void set(const double *from, long size, long instants) {
    constexpr long TILE = 8;
    size_ = size;
    if (long(numbers_.size()) != size * instants) numbers_.resize(size * instants);
    for (long k = 0; k < instants; k += TILE)
      for (long j = 0; j < size; j += TILE)
        for (long m = k; m < std::min(k + TILE, instants); ++m)
          for (long i = j; i < std::min(j + TILE, size); ++i) numbers_[m * size + i] = from[i * instants + m];
  }
  const double *at(long k) const { return numbers_.data() + k * size_; }

 private:
  long size_ = 0;
  std::vector<double> numbers_;
};

class Grid {
 public:
  Grid(const Grid &) = delete;
  // local (3, width, L): basis and two derivatives at a cell's samples; coefficients (cells, L) and samples (cells,
  // width): their indices; weights (2, 2 halo + 1): of the differences. The first `jets` of the outputs enter w with two
  // derivatives, the others alone; each has `size` coefficients in x, and the parameters follow them.
  // z is made of `row` of s, differentiated `order` times (both (z,)).
  Grid(Array local, Indices coefficients, Indices samples, Array weights, Indices row, Indices order, int outputs,
       int jets, int parameters, int size)
      : cells_(int(coefficients.shape(0))), L_(int(coefficients.shape(1))), width_(int(samples.shape(1))),
        halo_(int(weights.shape(1)) / 2), own_(width_ - 2 * halo_), jets_(jets), free_(outputs - jets),
        parameters_(parameters), size_(outputs * size + parameters), W_(3 * jets + free_ + parameters), local_(outputs * L_ + parameters),
        ld_(padded(local_)), instants_(cells_ * own_), table_(&lanes::best()) {
    const int32_t *s = numbers(samples, cells_, width_, "samples"), *c = coefficients.data();
    samples_.assign(s, s + cells_ * width_);
    for (int e = 0; e < cells_; ++e) {
      for (int a = 0; a < outputs; ++a)
        for (int l = 0; l < L_; ++l) index_.push_back(a * size + c[e * L_ + l]);
      for (int p = 0; p < parameters; ++p) index_.push_back(outputs * size + p);
    }
    const double *b = numbers(local, 3, width_ * L_, "local");
    expand_.grow(long(width_) * W_ * ld_);
    for (int t = 0; t < width_; ++t) {
      for (int a = 0; a < outputs; ++a)
        for (int d = 0; d < (a < jets ? 3 : 1); ++d)
          std::copy_n(b + (d * width_ + t) * L_, L_, expand(t, a < jets ? d * jets + a : 2 * jets + a) + a * L_);
      for (int p = 0; p < parameters; ++p) expand(t, 3 * jets + free_ + p)[outputs * L_ + p] = 1.0;
    }
    const double *g = numbers(weights, 2, 2 * halo_ + 1, "weights");
    weights_.assign(g, g + 2 * (2 * halo_ + 1));
    row_.assign(row.data(), row.data() + row.size());
    order_.assign(order.data(), order.data() + order.size());
  }

  // w without its parameters (3 jets + free, instants) from x.
  void spread(ConstArray x, Array w) const {
    const double *given = numbers(x, 1, size_, "x");
    double *to = numbers(w, W_ - parameters_, instants_, "w");
    std::vector<double> own(local_);
    for (int e = 0; e < cells_; ++e) {
      for (int i = 0; i < local_; ++i) own[i] = given[index_[e * local_ + i]];
      for (int i = 0; i < own_; ++i)
        for (int r = 0; r < W_ - parameters_; ++r) {
          const int first = output(r) * L_;
          const double *row = expand(halo_ + i, r) + first;
          double sum = 0;
          for (int l = 0; l < L_; ++l) sum += row[l] * own[first + l];
          to[r * instants_ + instant(e, halo_ + i)] = sum;
        }
    }
  }

  // z (z, instants) from s (rows, instants).
  void differentiate(Array s, Array z) const {
    const double *from = s.data();
    double *to = numbers(z, long(row_.size()), instants_, "z");
    for (std::size_t j = 0; j < row_.size(); ++j) {
      const double *values = from + row_[j] * instants_;
      if (!order_[j]) std::copy_n(values, instants_, to + j * instants_);
      else convolve(values, order_[j], false, to + j * instants_);
    }
  }

  // Its adjoint: s (rows, instants) from z.
  void differentiate_adjoint(Array z, Array s) const {
    const double *from = numbers(z, long(row_.size()), instants_, "z");
    double *to = s.data();
    std::fill_n(to, s.size(), 0.0);
    std::vector<double> part(instants_);
    for (std::size_t j = 0; j < row_.size(); ++j) {
      const double *values = from + j * instants_;
      if (order_[j]) {
        convolve(values, order_[j], true, part.data());
        values = part.data();
      }
      for (long k = 0; k < instants_; ++k) to[row_[j] * instants_ + k] += values[k];
    }
  }

  // x += sum_k E_k^T S_k^T s_k with S (rows W, instants), columns one after the other.
  void gather(Array S, Array s, Array x) const {
    const long rows = long(S.size()) / (W_ * instants_);
    const double *slope = numbers(S, rows * W_, instants_, "S"), *weight = numbers(s, rows, instants_, "s");
    std::vector<double> on_w(W_ * instants_, 0.0);
    for (int w = 0; w < W_; ++w)
      for (long j = 0; j < rows; ++j)
        for (long k = 0; k < instants_; ++k)
          on_w[w * instants_ + k] += slope[(w * rows + j) * instants_ + k] * weight[j * instants_ + k];
    double *to = numbers(x, 1, size_, "x");
    std::vector<double> own(ld_);
    for (int e = 0; e < cells_; ++e) {
      std::fill(own.begin(), own.end(), 0.0);
      for (int i = 0; i < own_; ++i)
        for (int r = 0; r < W_; ++r) {
          const double factor = on_w[r * instants_ + instant(e, halo_ + i)];
          const int first = r < W_ - parameters_ ? output(r) * L_ : local_ - W_ + r;
          const int last = r < W_ - parameters_ ? first + L_ : first + 1;
          const double *row = expand(halo_ + i, r);
          for (int l = first; l < last; ++l) own[l] += factor * row[l];
        }
      for (int i = 0; i < local_; ++i) to[index_[e * local_ + i]] += own[i];
    }
  }

  // Rows (cells, own samples, h, local variables) of dh_k/dx with J = dh/dz (h z, instants), columns one after the other.
  void jacobian(Array S, Array J, Array values) {
    const int nz = int(row_.size()), rows = int(J.size() / (nz * instants_));
    const double *slope = S.data(), *outer = numbers(J, rows * nz, instants_, "J");
    double *to = numbers(values, instants_ * rows, local_, "values");
    start(slope, long(S.size()) / (W_ * instants_));
    outer_.set(outer, nz * rows, instants_);
    Memory result(rows * ld_);
    for (int e = 0; e < cells_; ++e) {
      load_cell(e);
      for (int i = 0; i < own_; ++i) {
        load_sample(i, z_.begin);
        std::fill_n(result.begin, rows * ld_, 0.0);
        table_->accumulate(nz, rows, int(ld_), outer_.at(instant(e, halo_ + i)), rows, z_.begin, ld_, result.begin, ld_, false);
        for (int h = 0; h < rows; ++h, to += local_) std::copy_n(result.begin + h * ld_, local_, to);
      }
    }
  }

  // values[slot] += upper triangles of sum_k (dz_k/dx)^T Q_k dz_k/dx + E_k^T C_k E_k, with Q (z z, instants), C (W W,
  // instants) and slots (cells, local, local).
  void hessian(Array S, Array Q, Array C, Indices slots, Array values) {
    const int nz = int(row_.size());
    const double *slope = S.data(), *outer = numbers(Q, nz * nz, instants_, "Q"), *inner = numbers(C, W_ * W_, instants_, "C");
    const int32_t *slot = numbers(slots, cells_, local_ * local_, "slots");
    start(slope, long(S.size()) / (W_ * instants_));
    outer_.set(outer, nz * nz, instants_);
    inner_.set(inner, W_ * W_, instants_);
    Memory block(local_ * ld_), product(std::max(nz * TOGETHER, W_) * ld_);
    for (int e = 0; e < cells_; ++e) {
      load_cell(e);
      std::fill_n(block.begin, local_ * ld_, 0.0);
      for (int first = 0; first < own_; first += TOGETHER) {
        const int count = std::min(TOGETHER, own_ - first);
        std::fill_n(product.begin, nz * count * ld_, 0.0);
        for (int i = 0; i < count; ++i) {
          double *z = z_.begin + i * nz * ld_;
          load_sample(first + i, z);
          const double *factor = outer_.at(instant(e, halo_ + first + i));
          table_->accumulate(nz, nz, int(ld_), factor, nz, z, ld_, product.begin + i * nz * ld_, ld_, false);
        }
        table_->accumulate(nz * count, local_, int(ld_), z_.begin, ld_, product.begin, ld_, block.begin, ld_, true);
      }
      for (int i = 0; i < own_; ++i)
        add_curvature(halo_ + i, inner_.at(instant(e, halo_ + i)), product.begin, block.begin);
      if (cells_ == 1) add_filters(block.begin);
      const int32_t *at = slot + long(e) * local_ * local_;
      double *to = values.data();
      for (int i = 0; i < local_; ++i)
        for (int j = i; j < local_; ++j) to[at[i * local_ + j]] += block.begin[i * ld_ + j];
    }
  }

  // From now on row `to` of s holds e beside what the instants give: e = K u with u row `from`, K circulant with first
  // column `kernel` (instants,), and derivative `slope` (instants,) of e in a parameter. Needs a single cell.
  void filter(int position, int to, int from, int parameter, Array kernel, Array slope) {
    if (cells_ != 1) throw nb::value_error("a filter needs a single cell");
    if (std::size_t(position) >= filters_.size()) filters_.resize(position + 1);
    filters_[position] = {to, from, local_ - parameters_ + parameter, values(kernel), values(slope), {}, 0.0};
  }

  // For the next Hessian: weights (instants,) with which the derivative of K in the parameter meets u, and the second
  // derivative of weights^T e in it.
  void bend_filter(int position, Array mixed, double bend) {
    filters_.at(position).mixed = values(mixed);
    filters_.at(position).bend = bend;
  }

 private:
  struct Filter {
    int to, from, parameter;
    std::vector<double> kernel, slope, mixed;
    double bend;
  };

  std::vector<double> values(const Array &array) const {
    const double *x = numbers(array, 1, instants_, "filter");
    return std::vector<double>(x, x + instants_);
  }
  long instant(int cell, int sample) const { return samples_[cell * width_ + sample]; }
  int output(int row) const { return row < 3 * jets_ ? row % jets_ : row - 2 * jets_; }
  double *expand(int sample, int row) const { return expand_.begin + (long(sample) * W_ + row) * ld_; }

  void convolve(const double *values, int order, bool transposed, double *result) const {
    const double *g = weights_.data() + (order - 1) * (2 * halo_ + 1);
    std::vector<double> wrapped(instants_ + 2 * halo_);
    for (long k = 0; k < long(wrapped.size()); ++k) wrapped[k] = values[((k - halo_) % instants_ + instants_) % instants_];
    for (long k = 0; k < instants_; ++k) result[k] = 0.0;
    for (int o = 0; o <= 2 * halo_; ++o) {
      const double factor = g[transposed ? 2 * halo_ - o : o];
      for (long k = 0; k < instants_; ++k) result[k] += factor * wrapped[k + o];
    }
  }

  void start(const double *slope, long rows) {
    rows_ = rows;
    slope_.set(slope, rows * W_, instants_);
    signals_.grow(long(width_) * rows_ * ld_);
    z_.grow(long(row_.size()) * TOGETHER * ld_);
    if (!filters_.empty()) driven_.resize(filters_.size());
  }

  double *signal(int sample, int row) const { return signals_.begin + (long(sample) * rows_ + row) * ld_; }

  // ds/dx at all samples of a cell.
  void load_cell(int e) {
    std::fill_n(signals_.begin, long(width_) * rows_ * ld_, 0.0);
    for (int t = 0; t < width_; ++t) {
      const double *S = slope_.at(instant(e, t));
      for (int a = 0; a < jets_ + free_; ++a) {
        const Rows r = rows_of(a);
        const long begin = a * L_ / lanes::WIDEST * lanes::WIDEST, end = padded((a + 1) * L_);
        table_->accumulate(r.count, int(rows_), int(end - begin), S + r.first * rows_, r.step * rows_,
                           expand(t, r.first) + begin, r.step * ld_, signal(t, 0) + begin, ld_, false);
      }
      for (int p = 0; p < parameters_; ++p)
        for (int j = 0; j < rows_; ++j) signal(t, j)[local_ - parameters_ + p] += S[(W_ - parameters_ + p) * rows_ + j];
    }
    for (std::size_t f = 0; f < filters_.size(); ++f) apply(filters_[f], driven_[f]);
  }

  void apply(const Filter &filter, Memory &driven) {
    driven.grow(instants_ * ld_);  // du/dx at all instants
    for (int i = halo_; i < halo_ + own_; ++i) std::copy_n(signal(i, filter.from), ld_, driven.begin + instant(0, i) * ld_);
    Memory moved(instants_ * ld_), column(instants_);
    for (long k = 0; k < instants_; ++k) {
      for (long j = 0; j < instants_; ++j) column.begin[j] = filter.kernel[((k - j) % instants_ + instants_) % instants_];
      table_->accumulate(int(instants_), 1, int(ld_), column.begin, 1, driven.begin, ld_, moved.begin + k * ld_, ld_, false);
      moved.begin[k * ld_ + filter.parameter] += filter.slope[k];
    }
    for (int t = 0; t < width_; ++t)
      for (long l = 0; l < ld_; ++l) signal(t, filter.to)[l] += moved.begin[instant(0, t) * ld_ + l];
  }

  void add_filters(double *block) {
    for (std::size_t f = 0; f < filters_.size(); ++f) {
      const Filter &filter = filters_[f];
      Memory mixed(ld_);
      table_->accumulate(int(instants_), 1, int(ld_), filter.mixed.data(), 1, driven_[f].begin, ld_, mixed.begin, ld_, false);
      const int p = filter.parameter;
      for (int i = 0; i < p; ++i) block[i * ld_ + p] += mixed.begin[i];
      for (int j = p + 1; j < local_; ++j) block[p * ld_ + j] += mixed.begin[j];
      block[p * ld_ + p] += 2 * mixed.begin[p] + filter.bend;
    }
  }

  // dz/dx at an own sample of the loaded cell.
  void load_sample(int i, double *z) const {
    for (std::size_t j = 0; j < row_.size(); ++j, z += ld_) {
      if (!order_[j]) {
        std::copy_n(signal(halo_ + i, row_[j]), ld_, z);
        continue;
      }
      std::fill_n(z, ld_, 0.0);
      table_->accumulate(2 * halo_ + 1, 1, int(ld_), weights_.data() + (order_[j] - 1) * (2 * halo_ + 1), 1,
                         signal(i, row_[j]), rows_ * ld_, z, ld_, false);
    }
  }

  // block += E^T C E at a sample, on and above the diagonal; each output's rows of E are zero beside its coefficients.
  void add_curvature(int sample, const double *C, double *product, double *block) const {
    std::fill_n(product, W_ * ld_, 0.0);
    for (int a = 0; a < jets_ + free_; ++a) {
      const Rows r = rows_of(a);
      const long begin = a * L_ / lanes::WIDEST * lanes::WIDEST, end = padded((a + 1) * L_);
      table_->accumulate(r.count, W_, int(end - begin), C + r.first * W_, long(r.step) * W_, expand(sample, r.first) + begin,
                         r.step * ld_, product + begin, ld_, false);
    }
    const int fixed = W_ - parameters_, last = local_ - parameters_;
    for (int p = 0; p < parameters_; ++p)
      for (int w = 0; w < W_; ++w) product[w * ld_ + last + p] += C[(fixed + p) * W_ + w];
    for (int a = 0; a < jets_ + free_; ++a) {
      const Rows r = rows_of(a);
      const long begin = a * L_ / lanes::WIDEST * lanes::WIDEST;
      table_->accumulate(r.count, L_, int(ld_ - begin), expand(sample, r.first) + a * L_, r.step * ld_,
                         product + r.first * ld_ + begin, r.step * ld_, block + a * L_ * ld_ + begin, ld_, false);
    }
    for (int p = 0; p < parameters_; ++p)
      for (int j = last + p; j < local_; ++j) block[(last + p) * ld_ + j] += product[(fixed + p) * ld_ + j];
  }

  struct Rows {
    int first, step, count;
  };
  Rows rows_of(int output) const {  // of w
    return output < jets_ ? Rows{output, jets_, 3} : Rows{2 * jets_ + output, 1, 1};
  }

  int cells_, L_, width_, halo_, own_, jets_, free_, parameters_, size_, W_, local_;
  long ld_, instants_, rows_ = 0;
  const lanes::Table *table_;
  std::vector<int> samples_, index_, row_, order_;
  std::vector<double> weights_;
  std::vector<Filter> filters_;
  std::vector<Memory> driven_;
  Memory expand_, signals_, z_;
  ByInstant slope_, outer_, inner_;
};

}  // namespace

void register_grid(nb::module_ &m) {
  nb::class_<Grid>(m, "Grid")
      .def(nb::init<Array, Indices, Indices, Array, Indices, Indices, int, int, int, int>())
      .def("spread", &Grid::spread)
      .def("differentiate", &Grid::differentiate)
      .def("differentiate_adjoint", &Grid::differentiate_adjoint)
      .def("gather", &Grid::gather)
      .def("jacobian", &Grid::jacobian, nb::call_guard<nb::gil_scoped_release>())
      .def("hessian", &Grid::hessian, nb::call_guard<nb::gil_scoped_release>())
      .def("filter", &Grid::filter)
      .def("bend_filter", &Grid::bend_filter);
}
