// Warnings of CasADi, muted in a thread of its own choice: the standard streams are the whole process's.
#include <casadi/core/casadi_logger.hpp>
#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace {

thread_local bool muted = false;
void (*write_on)(const char *, std::streamsize, bool);

void write(const char *text, std::streamsize length, bool error) {
  if (!muted) write_on(text, length, error);
}

}  // namespace

void register_logger(nb::module_ &m) {
  write_on = casadi::Logger::writeFun;
  casadi::Logger::writeFun = write;
  m.def("mute", [](bool on) { muted = on; }, nb::arg("on"));
}
