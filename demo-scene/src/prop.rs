//! A thing at its place: frames, bounds, where a ray meets it.

use glam::{DVec2, DVec3};

use crate::clutter::Clutter;
use crate::paint::Material;
use crate::primitives::rounded_box;
use crate::room::Furniture;
use crate::subject::Subject;

/// What stands on the stage.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Thing {
    Target(Subject),
    Clutter(Clutter),
    Furniture(Furniture),
}

/// A thing at its place: turned about z, then moved.
#[derive(Clone, Debug)]
pub(crate) struct Prop {
    pub(crate) thing: Thing,
    origin: DVec3,
    /// Cosine and sine of the turn.
    turn: DVec2,
    /// Bounding box in the thing's own frame.
    half: DVec3,
    middle: DVec3,
    /// Bounding sphere in the stage frame.
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
}

impl Prop {
    pub(crate) fn new(thing: Thing, origin: DVec3, degrees: f64, bounds: (DVec3, DVec3)) -> Self {
        let angle = degrees.to_radians();
        let turn = DVec2::new(libm::cos(angle), libm::sin(angle));
        let (half, middle) = bounds;
        let mut prop = Self {
            thing,
            origin,
            turn,
            half,
            middle,
            centre: origin,
            radius: half.length(),
        };
        prop.centre = origin + prop.outward(middle);
        prop
    }

    /// The same, turned by `angle` radians about z through `axis`.
    pub(crate) fn turned(&self, axis: DVec3, angle: f64) -> Self {
        let by = DVec2::new(libm::cos(angle), libm::sin(angle));
        let around = |v: DVec3| axis + by.rotate((v - axis).truncate()).extend(v.z - axis.z);
        Self {
            origin: around(self.origin),
            turn: by.rotate(self.turn),
            centre: around(self.centre),
            ..self.clone()
        }
    }

    fn inward(&self, v: DVec3) -> DVec3 {
        let (c, s) = (self.turn.x, self.turn.y);
        DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z)
    }

    fn outward(&self, v: DVec3) -> DVec3 {
        let (c, s) = (self.turn.x, self.turn.y);
        DVec3::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
    }

    /// Stage point to the thing's own frame.
    pub(crate) fn local(&self, p: DVec3) -> DVec3 {
        self.inward(p - self.origin)
    }

    /// The thing's own frame to the stage.
    pub(crate) fn place(&self, p: DVec3) -> DVec3 {
        self.outward(p) + self.origin
    }

    /// Signed distance of a point of the thing's own frame.
    pub(crate) fn local_sdf(&self, p: DVec3) -> f64 {
        match &self.thing {
            Thing::Target(subject) => subject.sdf(p),
            Thing::Clutter(clutter) => clutter.sdf(p),
            Thing::Furniture(_) => rounded_box(p - self.middle, self.half, 0.0),
        }
    }

    /// Signed distance of a stage point.
    pub(crate) fn sdf(&self, p: DVec3) -> f64 {
        self.local_sdf(self.local(p))
    }

    /// Signed distance as if hollow things were solid.
    pub(crate) fn filled_sdf(&self, p: DVec3) -> f64 {
        match &self.thing {
            Thing::Target(subject) => subject.filled_sdf(self.local(p)),
            Thing::Clutter(clutter) => clutter.filled_sdf(self.local(p)),
            Thing::Furniture(_) => self.sdf(p),
        }
    }

    /// Distance along the ray to the surface, between 0 and `limit`, and the normal where that is
    /// known already.
    pub(crate) fn meet(
        &self,
        from: DVec3,
        along: DVec3,
        limit: f64,
    ) -> Option<(f64, Option<DVec3>)> {
        // Most rays miss the bounding sphere.
        let to_centre = self.centre - from;
        let middle = to_centre.dot(along);
        let apart = to_centre.length_squared() - middle * middle;
        if apart > self.radius * self.radius
            || middle < -self.radius
            || middle - self.radius > limit
        {
            return None;
        }
        let (o, d) = (self.local(from) - self.middle, self.inward(along));
        let inverse = d.recip();
        let (a, b) = ((-self.half - o) * inverse, (self.half - o) * inverse);
        let near = a.min(b);
        let enter = near.max_element();
        let leave = a.max(b).min_element();
        if enter > leave || leave < 0.0 || enter > limit {
            return None;
        }
        let exact = matches!(
            self.thing,
            Thing::Furniture(_) | Thing::Clutter(Clutter::Sheet { .. })
        );
        if exact {
            let axis = if near.x >= near.y.max(near.z) {
                DVec3::X
            } else if near.y >= near.z {
                DVec3::Y
            } else {
                DVec3::Z
            };
            return (enter > 0.0).then(|| (enter, Some(self.outward(-d.signum() * axis))));
        }
        let (mut t, leave) = (enter.max(0.0), leave.min(limit));
        let o = o + self.middle;
        for _ in 0..80 {
            let h = self.local_sdf(o + d * t);
            if h < 1e-4 {
                return Some((t, None));
            }
            t += h;
            if t > leave {
                return None;
            }
        }
        None
    }

    /// Outward normal at a stage point on the surface.
    pub(crate) fn normal(&self, p: DVec3) -> DVec3 {
        const STEP: f64 = 3e-4;
        let q = self.local(p);
        let at = |x: f64, y: f64, z: f64| {
            let k = DVec3::new(x, y, z);
            k * self.local_sdf(q + k * STEP)
        };
        let sum =
            at(1.0, -1.0, -1.0) + at(-1.0, -1.0, 1.0) + at(-1.0, 1.0, -1.0) + at(1.0, 1.0, 1.0);
        self.outward(sum.normalize_or(DVec3::Z))
    }

    pub(crate) fn material(&self, p: DVec3, n: DVec3) -> Material {
        let (q, m) = (self.local(p), self.inward(n));
        match &self.thing {
            Thing::Target(subject) => subject.material(q),
            Thing::Clutter(clutter) => clutter.material(q, m),
            Thing::Furniture(piece) => piece.material(q - self.middle, m, self.half),
        }
    }
}
