// Reads the models that models.py wrote.
#pragma once
#include <fstream>
#include <pinocchio/multibody.hpp>
#include <pinocchio/multibody/joint.hpp>
#include <stdexcept>
#include <string>

namespace pin = pinocchio;

inline pin::JointModel joint_model(const std::string& kind, const Eigen::Vector3d& axis) {
  if (kind == "FreeFlyer") return pin::JointModelFreeFlyer();
  if (kind == "RX") return pin::JointModelRX();
  if (kind == "RY") return pin::JointModelRY();
  if (kind == "RZ") return pin::JointModelRZ();
  if (kind == "RevoluteUnaligned") return pin::JointModelRevoluteUnaligned(axis);
  if (kind == "PX") return pin::JointModelPX();
  if (kind == "PY") return pin::JointModelPY();
  if (kind == "PZ") return pin::JointModelPZ();
  if (kind == "PrismaticUnaligned") return pin::JointModelPrismaticUnaligned(axis);
  throw std::runtime_error("joint " + kind);
}

inline pin::Model read_model(const std::string& path) {
  std::ifstream file(path);
  file.exceptions(std::ios::failbit | std::ios::badbit);
  int joints, nq, nv;
  file >> joints >> nq >> nv;
  pin::Model model;
  for (int i = 0; i < joints; i++) {
    std::string name, kind;
    int parent;
    Eigen::Vector3d axis, translation, center;
    Eigen::Matrix3d rotation, inertia;
    double mass;
    auto read = [&](auto& m) {
      for (int r = 0; r < m.rows(); r++)
        for (int c = 0; c < m.cols(); c++) file >> m(r, c);
    };
    file >> name >> parent >> kind;
    read(axis);
    read(rotation);
    read(translation);
    file >> mass;
    read(center);
    read(inertia);
    const auto id = model.addJoint(parent, joint_model(kind, axis), pin::SE3(rotation, translation), name);
    model.appendBodyToJoint(id, pin::Inertia(mass, center, inertia));
  }
  if (model.nq != nq || model.nv != nv) throw std::runtime_error("dimensions of " + path);
  return model;
}
