//! Contact sets: resolved, checked, and their equations.

use crate::error::{ContactProblem, WholeBodyError};
use crate::layout::Layout;
use crate::least_squares::{Six, pseudo_inverse};
use crate::mechanics::Mechanics;
use crate::parameters::{ContactKind, ContactParameters, Hypothesis, WholeBodyParameters};
use dynamics::{Force, Model, Random, Se3};
use nalgebra::Vector3;
use problem::Problem;

/// A contact with unknowns.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    /// The caller's index of it.
    pub(crate) input: usize,
    pub(crate) link: usize,
    pub(crate) body: usize,
    /// The contact's frame (the link's axes, at the point) in the body's.
    pub(crate) placement: Se3,
    pub(crate) kind: ContactKind,
    /// Bodies whose joints of the same part carry it, outermost first.
    pub(crate) path: Vec<usize>,
}

impl Contact {
    /// Appends the wrenches of its unknowns, about `origin`, in the root's axes.
    pub(crate) fn columns(
        &self,
        mechanics: &Mechanics,
        origin: &Vector3<f64>,
        columns: &mut [Six; 6],
        from: usize,
    ) {
        let frame = mechanics.in_root[self.body].compose(&self.placement);
        let arm = frame.translation - origin;
        let along = |axis: Vector3<f64>| Force::new(axis, arm.cross(&axis)).to_array();
        let rotation = &frame.rotation;
        let mut put = |k: usize, column: Six| {
            if let Some(place) = columns.get_mut(from + k) {
                *place = column;
            }
        };
        match self.kind {
            ContactKind::FullWrench | ContactKind::PureForce => {
                for k in 0..3 {
                    put(k, along(rotation.column(k).into_owned()));
                }
            }
            ContactKind::KnownDirection(direction) => put(0, along(rotation * direction)),
            ContactKind::Nothing => {}
        }
        if self.kind == ContactKind::FullWrench {
            for k in 0..3 {
                let axis = rotation.column(k).into_owned();
                put(3 + k, Force::new(Vector3::zeros(), axis).to_array());
            }
        }
    }

    /// The wrench at the contact's frame of its unknowns' values.
    pub(crate) fn wrench(&self, x: &[f64]) -> Force {
        let at = |k: usize| x.get(k).copied().unwrap_or(0.0);
        let three = |k: usize| Vector3::new(at(k), at(k + 1), at(k + 2));
        match self.kind {
            ContactKind::FullWrench => Force::new(three(0), three(3)),
            ContactKind::PureForce => Force::new(three(0), Vector3::zeros()),
            ContactKind::KnownDirection(d) => Force::new(d * at(0), Vector3::zeros()),
            ContactKind::Nothing => Force::zero(),
        }
    }
}

/// A contact set, by parts.
#[derive(Debug, Clone)]
pub(crate) struct ContactSet {
    pub(crate) contacts: Vec<Contact>,
    /// Per part: its contacts, as a range of `contacts`, and their number of unknowns.
    pub(crate) parts: Vec<(std::ops::Range<usize>, usize)>,
}

impl ContactSet {
    pub(crate) fn new(
        model: &Model,
        layout: &Layout,
        p: &WholeBodyParameters,
        hypothesis: &Hypothesis,
    ) -> Result<Self, WholeBodyError> {
        let check = Check {
            model,
            layout,
            p,
            hypothesis,
        };
        check.run().map_err(|problem| WholeBodyError::Contacts {
            hypothesis: hypothesis.name.clone(),
            problem,
        })
    }

    /// True if a part has one full wrench: as many unknowns as equations, always solvable.
    pub(crate) fn single_full(&self, part: usize) -> Option<&Contact> {
        let (range, unknowns) = &self.parts[part];
        match &self.contacts[range.clone()] {
            [one] if *unknowns == 6 => Some(one),
            _ => None,
        }
    }

    /// The columns of a part's equations about `origin`.
    pub(crate) fn columns(
        &self,
        mechanics: &Mechanics,
        part: usize,
        origin: &Vector3<f64>,
    ) -> [Six; 6] {
        let mut columns = [[0.0; 6]; 6];
        let mut from = 0;
        for contact in &self.contacts[self.parts[part].0.clone()] {
            contact.columns(mechanics, origin, &mut columns, from);
            from += contact.kind.unknowns();
        }
        columns
    }
}

struct Check<'a> {
    model: &'a Model,
    layout: &'a Layout,
    p: &'a WholeBodyParameters,
    hypothesis: &'a Hypothesis,
}

impl Check<'_> {
    fn run(&self) -> Result<ContactSet, ContactProblem> {
        let all = &self.hypothesis.contacts;
        let mut contacts = Vec::new();
        let mut untouched = vec![false; self.layout.parts.len()];
        for (input, c) in all.iter().enumerate() {
            let link = self.model.frame_index(&c.link);
            let link = link.ok_or_else(|| ContactProblem::UnknownLink(c.link.clone()))?;
            if let Some(other) = all[..input].iter().position(|other| other == c) {
                return Err(ContactProblem::Twice(self.name(other)));
            }
            match c.kind {
                ContactKind::Nothing => untouched[self.layout.part_of_link[link]] = true,
                _ => contacts.push(self.resolve(input, link, c)?),
            }
        }
        // The result must not depend on the order in which contacts are listed.
        let part = |c: &Contact| self.layout.part_of_link[c.link];
        let key = |c: &Contact| {
            let p = c.placement.translation;
            let d = match c.kind {
                ContactKind::KnownDirection(d) => d,
                _ => Vector3::zeros(),
            };
            let numbers = [p.x, p.y, p.z, d.x, d.y, d.z];
            (part(c), c.link, c.kind.unknowns(), numbers)
        };
        contacts.sort_by(|a, b| {
            key(a)
                .partial_cmp(&key(b))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        let mut parts = Vec::new();
        for (g, &untouched) in untouched.iter().enumerate() {
            let start = contacts.partition_point(|c| part(c) < g);
            let end = contacts.partition_point(|c| part(c) <= g);
            let own = &contacts[start..end];
            let unknowns = self.count(g, own, untouched)?;
            parts.push((start..end, unknowns));
        }
        let set = ContactSet { contacts, parts };
        self.independent(&set)?;
        Ok(set)
    }

    fn resolve(
        &self,
        input: usize,
        link: usize,
        c: &ContactParameters,
    ) -> Result<Contact, ContactProblem> {
        let bad = |what: &str, allowed: &str| {
            ContactProblem::BadGeometry(Problem::new(what, allowed).of(self.name(input)))
        };
        if !c.point.iter().all(|x| x.is_finite()) {
            return Err(bad("point is not finite", "three finite numbers"));
        }
        let kind = match c.kind {
            ContactKind::KnownDirection(d) => {
                let length = d.norm();
                if !(length.is_finite() && length > 1e-6) {
                    return Err(bad(
                        "direction is not allowed",
                        "three finite numbers, not all zero",
                    ));
                }
                ContactKind::KnownDirection(d / length)
            }
            other => other,
        };
        let frame = &self.model.frames()[link];
        let point = Se3::new(Se3::identity().rotation, c.point);
        let piece = self.layout.piece_of_link(self.model, link);
        Ok(Contact {
            input,
            link,
            body: frame.body,
            placement: frame.placement.compose(&point),
            kind,
            path: self.layout.path(piece),
        })
    }

    /// Number of unknowns of a part, if it is allowed.
    fn count(
        &self,
        part: usize,
        own: &[Contact],
        untouched: bool,
    ) -> Result<usize, ContactProblem> {
        let described = || self.layout.describe(self.model, self.p, part);
        let unknowns = own.iter().map(|c| c.kind.unknowns()).sum();
        match own.first() {
            Some(contact) if untouched => {
                return Err(ContactProblem::NothingAndSomething {
                    part: described(),
                    contact: self.name(contact.input),
                });
            }
            None if untouched && self.layout.parts[part].fixed_by_stand => {
                return Err(ContactProblem::StandTouches(described()));
            }
            None if !untouched => {
                let first = self.layout.parts[part].first_link;
                return Err(ContactProblem::NoneDeclared {
                    part: described(),
                    link: self.model.frames()[first].name.clone(),
                });
            }
            _ => {}
        }
        if unknowns > 6 {
            return Err(ContactProblem::TooMany {
                part: described(),
                unknowns,
                contacts: self.list(own),
            });
        }
        Ok(unknowns)
    }

    /// Contacts that depend on one another at every pose are refused; at a few poses, flagged.
    fn independent(&self, set: &ContactSet) -> Result<(), ContactProblem> {
        const POSES: usize = 3;
        let mut mechanics = Mechanics::new(self.model, self.layout);
        let mut random = Random::new(1);
        let mut best = vec![0; set.parts.len()];
        for _ in 0..POSES {
            let q = random.vector(self.model.joint_count(), 1.5);
            mechanics.place(&q);
            for (part, best) in best.iter_mut().enumerate() {
                let origin = mechanics.origin(self.model, self.layout, part);
                let columns = set.columns(&mechanics, part, &origin);
                let n = set.parts[part].1;
                *best = (*best).max(pseudo_inverse(&columns, n, &mut [[0.0; 6]; 6]));
            }
        }
        for (part, (range, unknowns)) in set.parts.iter().enumerate() {
            if best[part] < *unknowns {
                return Err(ContactProblem::Dependent {
                    part: self.layout.describe(self.model, self.p, part),
                    unknowns: *unknowns,
                    rank: best[part],
                    contacts: self.list(&set.contacts[range.clone()]),
                });
            }
        }
        Ok(())
    }

    fn list(&self, contacts: &[Contact]) -> String {
        let names: Vec<String> = contacts.iter().map(|c| self.name(c.input)).collect();
        names.join(", ")
    }

    fn name(&self, input: usize) -> String {
        contact_name(&self.hypothesis.contacts[input])
    }
}

/// A contact in words.
fn contact_name(c: &ContactParameters) -> String {
    let kind = match c.kind {
        ContactKind::FullWrench => "the full wrench",
        ContactKind::PureForce => "the pure force",
        ContactKind::KnownDirection(_) => "the force of known direction",
        ContactKind::Nothing => "`none`",
    };
    let at = if c.point == Vector3::zeros() {
        String::new()
    } else {
        format!(" at [{}, {}, {}] m", c.point.x, c.point.y, c.point.z)
    };
    format!("{kind} on link `{}`{at}", c.link)
}
