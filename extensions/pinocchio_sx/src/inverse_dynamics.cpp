// Inverse dynamics of an arm as a CasADi function: Pinocchio's recursion run on symbols.
//
//   inverse_dynamics(links) -> serialized Function (q, v, a, gravity, mass, com) -> tau
//
// q, v, a, tau: one entry per link. gravity (3) [m/s^2] in the base frame; a point mass [kg] at com (3) [m] in the
// last link's frame. Joint positions are angles for joints without an end too, so every joint has one coordinate.

#include <pinocchio/autodiff/casadi.hpp>

#include <pinocchio/multibody.hpp>

#include <pinocchio/algorithm/rnea.hpp>

#include <casadi/casadi.hpp>
#include <casadi/config.h>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Symbol = casadi::SX;
using Matrix3 = std::array<std::array<double, 3>, 3>;
using Matrix4 = std::array<std::array<double, 4>, 4>;
using Vector3 = std::array<double, 3>;

/// The joints that an arm is made of: about and along the coordinate axes, and about and along any axis.
template<typename S, int O>
struct ArmJoints
{
  using Scalar = S;
  static constexpr int Options = O;

  using TurnX = pinocchio::JointModelRevoluteTpl<S, O, 0>;
  using TurnY = pinocchio::JointModelRevoluteTpl<S, O, 1>;
  using TurnZ = pinocchio::JointModelRevoluteTpl<S, O, 2>;
  using Turn = pinocchio::JointModelRevoluteUnalignedTpl<S, O>;
  using SlideX = pinocchio::JointModelPrismaticTpl<S, O, 0>;
  using SlideY = pinocchio::JointModelPrismaticTpl<S, O, 1>;
  using SlideZ = pinocchio::JointModelPrismaticTpl<S, O, 2>;
  using Slide = pinocchio::JointModelPrismaticUnalignedTpl<S, O>;

  using JointModelVariant = boost::variant<TurnX, TurnY, TurnZ, Turn, SlideX, SlideY, SlideZ, Slide>;
  using JointDataVariant = boost::variant<
    pinocchio::JointDataRevoluteTpl<S, O, 0>,
    pinocchio::JointDataRevoluteTpl<S, O, 1>,
    pinocchio::JointDataRevoluteTpl<S, O, 2>,
    pinocchio::JointDataRevoluteUnalignedTpl<S, O>,
    pinocchio::JointDataPrismaticTpl<S, O, 0>,
    pinocchio::JointDataPrismaticTpl<S, O, 1>,
    pinocchio::JointDataPrismaticTpl<S, O, 2>,
    pinocchio::JointDataPrismaticUnalignedTpl<S, O>>;
};

using NumericModel = pinocchio::ModelTpl<double, 0, ArmJoints>;
using SymbolicModel = pinocchio::ModelTpl<Symbol, 0, ArmJoints>;
using SymbolicData = pinocchio::DataTpl<Symbol, 0, ArmJoints>;
using Kinds = ArmJoints<double, 0>;
using SymbolVector = Eigen::Matrix<Symbol, Eigen::Dynamic, 1>;
using SymbolVector3 = Eigen::Matrix<Symbol, 3, 1>;
using SymbolMatrix3 = Eigen::Matrix<Symbol, 3, 3>;

/// One link and its joint; the fields are those of energy_opt.robot.Link.
struct Link
{
  bool prismatic;
  int parent; ///< index of the parent link, -1 for the base
  Matrix4 placement;
  Vector3 axis;
  double mass;
  Vector3 lever;
  Matrix3 inertia;
  double armature;
};

Eigen::Vector3d vector(const Vector3 & x)
{
  return {x[0], x[1], x[2]};
}

Eigen::Matrix3d matrix(const Matrix3 & x)
{
  Eigen::Matrix3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out(i, j) = x[i][j];
  return out;
}

pinocchio::SE3 pose(const Matrix4 & x)
{
  pinocchio::SE3 out;
  for (int i = 0; i < 3; ++i)
  {
    for (int j = 0; j < 3; ++j)
      out.rotation()(i, j) = x[i][j];
    out.translation()[i] = x[i][3];
  }
  return out;
}

/// The shortest joint model for an axis: constants that are 0 or 1 leave no trace in the expression.
NumericModel::JointModel joint(const Link & link)
{
  const Eigen::Vector3d axis = vector(link.axis);
  const bool slides = link.prismatic;
  if (axis == Eigen::Vector3d::UnitX())
    return slides ? NumericModel::JointModel(Kinds::SlideX()) : NumericModel::JointModel(Kinds::TurnX());
  if (axis == Eigen::Vector3d::UnitY())
    return slides ? NumericModel::JointModel(Kinds::SlideY()) : NumericModel::JointModel(Kinds::TurnY());
  if (axis == Eigen::Vector3d::UnitZ())
    return slides ? NumericModel::JointModel(Kinds::SlideZ()) : NumericModel::JointModel(Kinds::TurnZ());
  return slides ? NumericModel::JointModel(Kinds::Slide(axis)) : NumericModel::JointModel(Kinds::Turn(axis));
}

NumericModel numeric_model(const std::vector<Link> & links)
{
  NumericModel model;
  for (std::size_t k = 0; k < links.size(); ++k)
  {
    const Link & link = links[k];
    if (link.parent < -1 || link.parent >= static_cast<int>(k))
      throw std::invalid_argument("link " + std::to_string(k) + ": parents must come before children");
    const auto id = model.addJoint(link.parent + 1, joint(link), pose(link.placement), "joint" + std::to_string(k));
    model.inertias[id] = pinocchio::Inertia(link.mass, vector(link.lever), matrix(link.inertia));
    model.armature[model.idx_vs[id]] = link.armature;
  }
  return model;
}

SymbolVector column(const Symbol & x)
{
  SymbolVector out(x.size1());
  for (casadi_int i = 0; i < x.size1(); ++i)
    out[i] = x(i);
  return out;
}

std::string inverse_dynamics(const std::vector<Link> & links)
{
  if (links.empty())
    throw std::invalid_argument("no link");
  SymbolicModel model = numeric_model(links).cast<Symbol>();
  const Symbol q = Symbol::sym("q", model.nq), v = Symbol::sym("v", model.nv), a = Symbol::sym("a", model.nv);
  const Symbol gravity = Symbol::sym("gravity", 3), mass = Symbol::sym("mass"), com = Symbol::sym("com", 3);

  model.gravity.linear() = SymbolVector3(column(gravity));
  const SymbolMatrix3 none = SymbolMatrix3::Constant(Symbol(0));
  model.inertias.back() += pinocchio::InertiaTpl<Symbol, 0>(mass, SymbolVector3(column(com)), none);

  SymbolicData data(model);
  pinocchio::rnea(model, data, column(q), column(v), column(a));
  std::vector<Symbol> tau;
  for (int i = 0; i < model.nv; ++i)
    tau.push_back(data.tau[i]);
  return casadi::Function(
           "tau", {q, v, a, gravity, mass, com}, {Symbol::vertcat(tau)},
           {"q", "v", "a", "gravity", "mass", "com"}, {"tau"})
    .serialize();
}

} // namespace

PYBIND11_MODULE(_core, m)
{
  namespace py = pybind11;
  py::class_<Link>(m, "Link")
    .def(
      py::init<bool, int, Matrix4, Vector3, double, Vector3, Matrix3, double>(), py::arg("prismatic"),
      py::arg("parent"), py::arg("placement"), py::arg("axis"), py::arg("mass"), py::arg("lever"),
      py::arg("inertia"), py::arg("armature"));
  m.def("inverse_dynamics", &inverse_dynamics, py::arg("links"));
  m.attr("casadi_version") = CASADI_VERSION_STRING;
}
