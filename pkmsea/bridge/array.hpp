// NumPy arrays as the bridge takes them: float64 or int32 in C order, made by the Python side.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <memory>
#include <string>

namespace nb = nanobind;

using Array = nb::ndarray<double, nb::c_contig, nb::device::cpu>;
using ConstArray = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<int32_t, nb::c_contig, nb::device::cpu>;

// The array's numbers, if there are rows x columns of them.
template <typename A>
auto *numbers(const A &array, long rows, long columns, const std::string &who) {
  if (long(array.size()) != rows * columns)
    throw nb::value_error(("an array of '" + who + "' has another size than " + std::to_string(rows) + " x " +
                           std::to_string(columns)).c_str());
  return array.data();
}

// Doubles on a cache line of their own.
struct Memory {
  std::unique_ptr<double[]> owner;
  double *begin = nullptr;
  Memory() = default;
  explicit Memory(long size) { grow(size); }
  void grow(long size) {
    owner.reset(new double[size + 8]());
    begin = owner.get();
    begin += (64 - reinterpret_cast<std::uintptr_t>(begin) % 64) % 64 / sizeof(double);
  }
};
