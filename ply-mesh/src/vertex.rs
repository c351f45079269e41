//! A vertex as a file has it.

use glam::{DVec3, Vec3};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

/// Names of a vertex's properties.
pub(crate) const POSITION: [&str; 3] = ["x", "y", "z"];
pub(crate) const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
pub(crate) const COLOUR: [&str; 3] = ["red", "green", "blue"];

/// What a file lacks stays as it is in a new one: a position that is refused, no normal, white.
pub(crate) struct Vertex {
    pub(crate) position: DVec3,
    pub(crate) normal: Vec3,
    pub(crate) colour: [u8; 3],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self {
            position: DVec3::NAN,
            normal: Vec3::ZERO,
            colour: [255; 3],
        }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let [place, normal, colour] = [POSITION, NORMAL, COLOUR].map(|names| at(names, name));
        // Whatever its type is.
        if place.or(normal).or(colour).is_none() {
            return PropertyAccessResult::Ignored;
        }
        let number = match value {
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        if let Some(axis) = place {
            self.position[axis] = number;
        } else if let Some(axis) = normal {
            self.normal[axis] = number as f32;
        } else if let Some(channel) = colour {
            self.colour[channel] = number.clamp(0.0, 255.0) as u8;
        }
        PropertyAccessResult::Set
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        at(POSITION, name).map(|axis| self.position[axis])
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        let normal = at(NORMAL, name).map(|axis| self.normal[axis]);
        normal.or_else(|| self.get_double(name).map(|value| value as f32))
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        at(COLOUR, name).map(|channel| self.colour[channel])
    }
}

fn at(names: [&str; 3], name: &str) -> Option<usize> {
    names.iter().position(|known| *known == name)
}
