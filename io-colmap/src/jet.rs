//! A number that carries its derivatives by two variables, so that each lens formula is written
//! once and its Jacobian cannot disagree with it.

use std::ops::{Add, Div, Mul};

/// What a lens formula is written in: a number, or one with its derivatives.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Mul<Output = Self> + Mul<f64, Output = Self> + Div<Output = Self>
{
    fn constant(value: f64) -> Self;
}

impl Number for f64 {
    fn constant(value: f64) -> f64 {
        value
    }
}

impl Number for Jet {
    fn constant(value: f64) -> Jet {
        Jet {
            value,
            by_u: 0.0,
            by_v: 0.0,
        }
    }
}

/// `value` and its partial derivatives by u and v.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Jet {
    pub(crate) value: f64,
    pub(crate) by_u: f64,
    pub(crate) by_v: f64,
}

impl Jet {
    pub(crate) fn u(value: f64) -> Jet {
        Jet {
            value,
            by_u: 1.0,
            by_v: 0.0,
        }
    }

    pub(crate) fn v(value: f64) -> Jet {
        Jet {
            value,
            by_u: 0.0,
            by_v: 1.0,
        }
    }
}

impl Add for Jet {
    type Output = Jet;
    fn add(self, o: Jet) -> Jet {
        Jet {
            value: self.value + o.value,
            by_u: self.by_u + o.by_u,
            by_v: self.by_v + o.by_v,
        }
    }
}

impl Mul for Jet {
    type Output = Jet;
    fn mul(self, o: Jet) -> Jet {
        Jet {
            value: self.value * o.value,
            by_u: self.by_u * o.value + self.value * o.by_u,
            by_v: self.by_v * o.value + self.value * o.by_v,
        }
    }
}

impl Mul<f64> for Jet {
    type Output = Jet;
    fn mul(self, k: f64) -> Jet {
        Jet {
            value: self.value * k,
            by_u: self.by_u * k,
            by_v: self.by_v * k,
        }
    }
}

impl Div for Jet {
    type Output = Jet;
    fn div(self, o: Jet) -> Jet {
        let q = self.value / o.value;
        Jet {
            value: q,
            by_u: (self.by_u - q * o.by_u) / o.value,
            by_v: (self.by_v - q * o.by_v) / o.value,
        }
    }
}
