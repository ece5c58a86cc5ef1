// Pinocchio's algorithms behind a C interface, so that one process can time all candidates.
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include "pinocchio_model.hpp"

struct Robot {
  pin::Model model;
  pin::Data data;
  explicit Robot(const char* path) : model(read_model(path)), data(model) {}
  Eigen::Map<const Eigen::VectorXd> q(const double* x) const { return {x, model.nq}; }
  Eigen::Map<const Eigen::VectorXd> v(const double* x) const { return {x, model.nv}; }
};

extern "C" {
Robot* robot_new(const char* path) try { return new Robot(path); } catch (const std::exception&) { return nullptr; }
const double* robot_rnea(Robot* r, const double* q, const double* v, const double* a) {
  return pin::rnea(r->model, r->data, r->q(q), r->v(v), r->v(a)).data();
}
const double* robot_crba_local(Robot* r, const double* q, const double*, const double*) {
  return pin::crba(r->model, r->data, r->q(q), pin::Convention::LOCAL).data();
}
const double* robot_crba_world(Robot* r, const double* q, const double*, const double*) {
  return pin::crba(r->model, r->data, r->q(q), pin::Convention::WORLD).data();
}
const double* robot_aba_local(Robot* r, const double* q, const double* v, const double* tau) {
  return pin::aba(r->model, r->data, r->q(q), r->v(v), r->v(tau), pin::Convention::LOCAL).data();
}
const double* robot_aba_world(Robot* r, const double* q, const double* v, const double* tau) {
  return pin::aba(r->model, r->data, r->q(q), r->v(v), r->v(tau), pin::Convention::WORLD).data();
}
}
