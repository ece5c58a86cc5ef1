//! All tests of `identification` in one program, which is built and linked once.

#[path = "common/arm_link.rs"]
mod arm_link;
mod arms;
#[path = "common/bench.rs"]
mod bench;
mod contradictions;
mod defects;
mod drive;
mod feed_forward;
mod fit;
mod inertia;
mod inputs;
mod learned;
mod least_squares;
mod load;
mod log;
mod motor;
#[path = "common/other_joint.rs"]
mod other_joint;
#[path = "common/spoilt.rs"]
mod spoilt;
