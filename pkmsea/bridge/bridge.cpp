// Pinocchio's rigid-body algorithms on CasADi's SX scalar.
//
// Python hands over the numbers of a pin.Model; this module rebuilds the model on casadi::SX, runs Pinocchio's own
// crba, rnea and kinematics on symbols, and hands each result back as the text of casadi::Function::serialize().
#include <pinocchio/autodiff/casadi.hpp>

#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <casadi/config.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;
using SX = ::casadi::SX;

// One revolute and one prismatic joint, each about or along any axis, cover what pkmsea supports. SX folds products
// with the zeros and ones of an aligned axis, so the specialised joints of Pinocchio's default collection would only
// cost compile time. Composite and mimic stay because Pinocchio's visitors name them.
template <typename _Scalar, int _Options>
struct JointCollection {
  using Scalar = _Scalar;
  static constexpr int Options = _Options;
  using JointModelRevoluteUnaligned = pinocchio::JointModelRevoluteUnalignedTpl<Scalar, Options>;
  using JointModelPrismaticUnaligned = pinocchio::JointModelPrismaticUnalignedTpl<Scalar, Options>;
  using JointModelComposite = pinocchio::JointModelCompositeTpl<Scalar, Options, ::JointCollection>;
  using JointModelMimic = pinocchio::JointModelMimicTpl<Scalar, Options, ::JointCollection>;
  using JointModelVariant =
      boost::variant<JointModelRevoluteUnaligned, JointModelPrismaticUnaligned,
                     boost::recursive_wrapper<JointModelComposite>, boost::recursive_wrapper<JointModelMimic>>;
  using JointDataRevoluteUnaligned = pinocchio::JointDataRevoluteUnalignedTpl<Scalar, Options>;
  using JointDataPrismaticUnaligned = pinocchio::JointDataPrismaticUnalignedTpl<Scalar, Options>;
  using JointDataComposite = pinocchio::JointDataCompositeTpl<Scalar, Options, ::JointCollection>;
  using JointDataMimic = pinocchio::JointDataMimicTpl<Scalar, Options, ::JointCollection>;
  using JointDataVariant =
      boost::variant<JointDataRevoluteUnaligned, JointDataPrismaticUnaligned,
                     boost::recursive_wrapper<JointDataComposite>, boost::recursive_wrapper<JointDataMimic>>;
};

using Model = pinocchio::ModelTpl<SX, 0, JointCollection>;
using Data = pinocchio::DataTpl<SX, 0, JointCollection>;
using SE3 = pinocchio::SE3Tpl<SX, 0>;
using Vector = Eigen::Matrix<SX, Eigen::Dynamic, 1>;
using Matrix = Eigen::Matrix<SX, Eigen::Dynamic, Eigen::Dynamic>;
using Vector3 = Eigen::Matrix<SX, 3, 1>;
using Matrix3 = Eigen::Matrix<SX, 3, 3>;

using Triple = std::array<double, 3>;
using Rotation = std::array<double, 9>;  // row-major

struct Joint {
  std::size_t parent;
  bool revolute;  // otherwise prismatic
  Triple axis;
  Rotation rotation;  // placement in the parent joint
  Triple translation;
  double mass;
  Triple lever;      // centre of mass in the joint frame [m]
  Rotation inertia;  // about the centre of mass [kg m^2]
};

struct Frame {
  std::size_t joint;
  Rotation rotation;
  Triple translation;
};

static Vector3 vector(const Triple &x) { return Vector3(SX(x[0]), SX(x[1]), SX(x[2])); }

static Matrix3 matrix(const Rotation &x) {
  Matrix3 result;
  for (int i = 0; i < 9; ++i) result(i / 3, i % 3) = SX(x[i]);
  return result;
}

static Model build(const std::vector<Joint> &joints, const std::vector<Frame> &frames, const Triple &gravity) {
  Model model;
  model.gravity.linear(vector(gravity));
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Joint &joint = joints[i];
    const SE3 placement(matrix(joint.rotation), vector(joint.translation));
    const std::string name = "joint" + std::to_string(i + 1);
    const auto id = joint.revolute
        ? model.addJoint(joint.parent, Model::JointCollection::JointModelRevoluteUnaligned(vector(joint.axis)), placement, name)
        : model.addJoint(joint.parent, Model::JointCollection::JointModelPrismaticUnaligned(vector(joint.axis)), placement, name);
    const Matrix3 I = matrix(joint.inertia);
    pinocchio::Symmetric3Tpl<SX, 0> symmetric;
    symmetric.data() << I(0, 0), I(1, 0), I(1, 1), I(2, 0), I(2, 1), I(2, 2);
    model.inertias[id] = Model::Inertia(SX(joint.mass), vector(joint.lever), symmetric);
  }
  for (std::size_t i = 0; i < frames.size(); ++i)
    model.addFrame(pinocchio::FrameTpl<SX, 0>("frame" + std::to_string(i), frames[i].joint,
                                              SE3(matrix(frames[i].rotation), vector(frames[i].translation)),
                                              pinocchio::OP_FRAME), false);
  return model;
}

template <typename Derived>
static SX to_casadi(const Eigen::MatrixBase<Derived> &x) {
  SX result(::casadi::Sparsity::dense(x.rows(), x.cols()));
  for (Eigen::Index j = 0; j < x.cols(); ++j)
    for (Eigen::Index i = 0; i < x.rows(); ++i) result(i, j) = x(i, j);
  return ::casadi::SX::sparsify(result);
}

static Vector from_casadi(const SX &x) {
  Vector result(x.size1());
  for (Eigen::Index i = 0; i < result.size(); ++i) result[i] = x(i);
  return result;
}

static std::vector<std::string> functions(const std::vector<Joint> &joints, const std::vector<Frame> &frames,
                                          const Triple &gravity) {
  const Model model = build(joints, frames, gravity);
  Data data(model);
  const SX q = SX::sym("q", model.nq), v = SX::sym("v", model.nv), a = SX::sym("a", model.nv);
  const Vector q_ = from_casadi(q), v_ = from_casadi(v), a_ = from_casadi(a);
  using ::casadi::Function;

  pinocchio::crba(model, data, q_, pinocchio::Convention::WORLD);
  const SX upper = to_casadi(data.M);
  const SX M = SX::triu2symm(SX::triu(upper));
  const SX tau = to_casadi(pinocchio::rnea(model, data, q_, v_, a_));
  const SX h = to_casadi(pinocchio::rnea(model, data, q_, v_, Vector::Zero(model.nv)));

  std::vector<SX> placements, jacobians;
  pinocchio::computeJointJacobians(model, data, q_);
  pinocchio::updateFramePlacements(model, data);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto id = model.frames.size() - frames.size() + i;
    placements.push_back(to_casadi(data.oMf[id].toHomogeneousMatrix()));
    Eigen::Matrix<SX, 6, Eigen::Dynamic> J = Eigen::Matrix<SX, 6, Eigen::Dynamic>::Zero(6, model.nv);
    pinocchio::getFrameJacobian(model, data, id, pinocchio::LOCAL_WORLD_ALIGNED, J);
    jacobians.push_back(to_casadi(J));
  }
  return {Function("mass_matrix", {q}, {M}, {"q"}, {"M"}).serialize(),
          Function("inverse_dynamics", {q, v, a}, {tau}, {"q", "v", "a"}, {"tau"}).serialize(),
          Function("bias", {q, v}, {h}, {"q", "v"}, {"h"}).serialize(),
          Function("frame_placements", {q}, {SX::vertcat(placements)}, {"q"}, {"T"}).serialize(),
          Function("frame_jacobians", {q}, {SX::vertcat(jacobians)}, {"q"}, {"J"}).serialize()};
}

void register_machine(nb::module_ &m);  // machine.cpp
void register_grid(nb::module_ &m);     // grid.cpp
void register_logger(nb::module_ &m);   // logger.cpp

NB_MODULE(_bridge, m) {
  nb::set_leak_warnings(false);  // programs in Python's caches live until the interpreter has gone
  register_machine(m);
  register_grid(m);
  register_logger(m);
  m.attr("casadi_version") = CASADI_VERSION_STRING;
  nb::class_<Joint>(m, "Joint")
      .def(nb::init<std::size_t, bool, Triple, Rotation, Triple, double, Triple, Rotation>());
  nb::class_<Frame>(m, "Frame").def(nb::init<std::size_t, Rotation, Triple>());
  m.def("functions", &functions, nb::arg("joints"), nb::arg("frames"), nb::arg("gravity"));
}
