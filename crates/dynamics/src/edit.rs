//! Models made from models, at set-up: joints locked, parts taken off, another root.

use crate::body::Body;
use crate::model::{Base, Frame, Joint, Model};
use crate::spatial::Se3;
use std::collections::BTreeMap;

impl Model {
    /// The model with joints held at given positions (index, rad or m); they leave `q` and `v`, and
    /// their mimic joints stay where that puts them.
    pub fn with_locked_joints(&self, locked: &[(usize, f64)]) -> Model {
        let locked: BTreeMap<usize, f64> = locked.iter().copied().collect();
        let mut parts = Parts::of(self);
        // The new body of each old one, and the old frame in it.
        let mut place: Vec<(usize, Se3)> = vec![(0, Se3::identity())];
        for i in 1..self.bodies.len() {
            let body = &self.bodies[i];
            let (on, at) = place[body.parent];
            match locked.get(&body.joint) {
                Some(q) => {
                    let fixed = body.placement_at(q * body.ratio + body.offset);
                    place.push((on, at.compose(&fixed)));
                }
                None => place.push((i, Se3::identity())),
            }
            let (new, in_new) = place[i];
            parts.bodies[i].parent = on;
            parts.bodies[i].placement = at.compose(&body.placement);
            if new != i {
                parts.gone[i] = true;
                parts.bodies[new].inertia += body.inertia.transformed(&in_new);
            }
        }
        for frame in &mut parts.frames {
            let (new, in_new) = place[frame.body];
            frame.rigid |= new != frame.body && frame.parent.is_some();
            frame.placement = in_new.compose(&frame.placement);
            frame.body = new;
        }
        parts.build(self, self.base)
    }

    /// The model without a link and all that it carries; nothing if that is the root.
    pub fn without(&self, frame: usize) -> Option<Model> {
        let cut = self.cut(frame)?;
        self.frames[frame].parent?;
        let mut parts = Parts::of(self);
        let in_body = cut.inertia.transformed(&self.frames[frame].placement);
        let whole = !self.frames[frame].rigid;
        for i in 1..self.bodies.len() {
            let carried = cut.children.iter().any(|c| self.supports(*c, i));
            parts.gone[i] = carried || (whole && i == cut.body);
        }
        if !whole {
            let body = &mut parts.bodies[cut.body];
            body.inertia = body.inertia - in_body;
        }
        parts.keep_frames(|f| !self.hangs_on(f, frame));
        Some(parts.build(self, self.base))
    }

    /// The same robot with another link as its root: that link's frame is then what `q` and `v` of
    /// a floating base describe, or what a fixed base holds. Joints keep their names and signs.
    pub fn rerooted(&self, frame: usize, base: Base) -> Option<Model> {
        let root = self.frames.get(frame)?;
        let mut parts = Parts::of(self);
        let mut path = vec![root.body];
        while let Some(parent) = self.parent(path[path.len() - 1]) {
            path.push(parent);
        }
        // New frame of each body on the path, in its old frame.
        let mut moved = vec![root.placement];
        for pair in path.windows(2) {
            moved.push(self.bodies[pair[0]].placement);
            // The joint below the new root's side now carries what was its parent.
            let (child, parent) = (&self.bodies[pair[0]], pair[1]);
            parts.bodies[parent] = Body {
                parent: pair[0],
                axis: -child.axis,
                placement: moved[moved.len() - 2].inverse(),
                ..child.clone()
            };
        }
        for (body, shift) in path.iter().zip(&moved) {
            parts.bodies[*body].inertia = self.bodies[*body].inertia.transformed(&shift.inverse());
        }
        let on_path: BTreeMap<usize, Se3> = path.iter().copied().zip(moved).collect();
        for i in 1..self.bodies.len() {
            let parent = self.bodies[i].parent;
            if let (None, Some(shift)) = (on_path.get(&i), on_path.get(&parent)) {
                parts.bodies[i].placement = shift.inverse().compose(&self.bodies[i].placement);
            }
        }
        for f in &mut parts.frames {
            if let Some(shift) = on_path.get(&f.body) {
                f.placement = shift.inverse().compose(&f.placement);
            }
        }
        parts.reverse_links(frame);
        parts.root = root.body;
        Some(parts.build(self, base))
    }
}

/// A model taken apart; bodies keep their old indices until `build`.
struct Parts {
    bodies: Vec<Body>,
    frames: Vec<Frame>,
    gone: Vec<bool>,
    root: usize,
}

impl Parts {
    fn of(model: &Model) -> Self {
        Parts {
            bodies: model.bodies.clone(),
            frames: model.frames.clone(),
            gone: vec![false; model.bodies.len()],
            root: 0,
        }
    }

    fn keep_frames(&mut self, keep: impl Fn(usize) -> bool) {
        let mut index = Vec::new();
        let mut kept = 0;
        for f in 0..self.frames.len() {
            index.push(kept);
            kept += usize::from(keep(f));
        }
        let frames = std::mem::take(&mut self.frames).into_iter().enumerate();
        self.frames = frames.filter(|(f, _)| keep(*f)).map(|(_, f)| f).collect();
        for frame in &mut self.frames {
            frame.parent = frame.parent.map(|p| index[p]);
        }
    }

    /// Makes `root` the link that carries all others.
    fn reverse_links(&mut self, root: usize) {
        let mut carrier: Option<(usize, bool)> = None;
        let mut at = Some(root);
        while let Some(frame) = at {
            let f = &mut self.frames[frame];
            let (parent, rigid) = (f.parent, f.rigid);
            (f.parent, f.rigid) = match carrier {
                Some((carrier, rigid)) => (Some(carrier), rigid),
                None => (None, false),
            };
            carrier = Some((frame, rigid));
            at = parent;
        }
    }

    /// Bodies in Pinocchio's order: depth first, children sorted by name.
    fn order(&self) -> Vec<usize> {
        let mut order = Vec::new();
        let mut stack = vec![self.root];
        while let Some(i) = stack.pop() {
            order.push(i);
            let is_child =
                |c: &usize| *c != self.root && !self.gone[*c] && self.bodies[*c].parent == i;
            let mut children: Vec<usize> = (0..self.bodies.len()).filter(is_child).collect();
            children.sort_by(|a, b| self.bodies[*b].name.cmp(&self.bodies[*a].name));
            stack.extend(children.into_iter().filter(|c| *c != i));
        }
        order
    }

    fn build(self, old: &Model, base: Base) -> Model {
        let order = self.order();
        let mut new_index = vec![0; self.bodies.len()];
        for (new, i) in order.iter().enumerate() {
            new_index[*i] = new;
        }
        let mut new_joint: Vec<Option<usize>> = vec![None; old.joints.len()];
        let mut joints: Vec<Joint> = Vec::new();
        let mut bodies: Vec<Body> = Vec::new();
        for (new, i) in order.iter().enumerate() {
            let mut body = self.bodies[*i].clone();
            if new == 0 {
                body.parent = 0;
                body.placement = Se3::identity();
                (body.ratio, body.offset, body.joint) = (1.0, 0.0, usize::MAX);
            } else {
                body.parent = new_index[body.parent];
            }
            bodies.push(body);
        }
        // A driving joint may come after its mimic joints: number the drivers first.
        for (new, body) in bodies.iter().enumerate().skip(1) {
            let joint = &old.joints[body.joint];
            if joint.name == body.name {
                new_joint[body.joint] = Some(joints.len());
                joints.push(Joint {
                    body: new,
                    ..joint.clone()
                });
            }
        }
        // Mimic joints whose driver was taken off: the first of them drives the others.
        for (new, body) in bodies.iter().enumerate().skip(1) {
            if new_joint[body.joint].is_none() {
                new_joint[body.joint] = Some(joints.len());
                joints.push(Joint {
                    body: new,
                    ..old.joints[body.joint].clone()
                });
            }
        }
        for body in bodies.iter_mut().skip(1) {
            body.joint = new_joint[body.joint].unwrap_or(0);
        }
        let mut frames = self.frames;
        for frame in &mut frames {
            frame.body = new_index[frame.body];
        }
        if let Some(root) = frames.iter().find(|f| f.parent.is_none()) {
            bodies[0].name.clone_from(&root.name);
        }
        let mut model = Model {
            base,
            bodies,
            joints,
            frames,
            ..old.clone()
        };
        model.finish();
        model
    }
}
