//! Geoms: shapes that collide, and mass where a body has no `<inertial>`.

use super::read::Reader;
use crate::base::error::Invalid;
use crate::exchange::source::{exactly, foreign, foreign_attribute, keyword, numbers};
use crate::exchange::tree::{Frame, Solid};
use crate::model::rigid::Lump;
use nalgebra::{Matrix3, Vector3};
use roxmltree::Node;
use std::f64::consts::PI;

/// MuJoCo's default density, kg/mu³.
const DENSITY: f64 = 1000.0;

/// Geom that can be imported.
pub(super) struct Geom {
    /// True if it collides.
    pub collides: bool,
    pub solid: Solid,
}

impl<'a> Reader<'a> {
    /// Returns true if a geom collides. Refuses geoms that collide only with some others.
    pub(super) fn collides(&self, geom: Node<'a, 'a>, class: &'a str) -> Result<bool, Invalid> {
        let bits = |attribute| -> Result<f64, Invalid> {
            let text = self.defaults.get(geom, class, attribute)?.unwrap_or("1");
            exactly::<1>(geom, attribute, text).map(|[v]| v)
        };
        match (bits("contype")?, bits("conaffinity")?) {
            (1.0, 1.0) => Ok(true),
            (0.0, 0.0) => Ok(false),
            (contype, conaffinity) => {
                let reason = format!(
                    "contype = {contype}, conaffinity = {conaffinity}: only 1 and 1 (it touches all others) or 0 and \
                     0 (it is only seen) are allowed"
                );
                Err(foreign(geom, reason))
            }
        }
    }

    /// Reads a geom at the frame `at` of its body. Returns `None` for a geom that is only visual.
    pub(super) fn geom(
        &self,
        geom: Node<'a, 'a>,
        class: &'a str,
        at: Frame,
        weighs: bool,
    ) -> Result<Option<Geom>, Invalid> {
        let get = |attribute| self.defaults.get(geom, class, attribute);
        let collides = self.collides(geom, class)?;
        if collides && self.number(geom, class, "condim")? == Some(1.0) {
            let reason = "condim = \"1\" (no friction) can't be imported: all contacts have the friction of a job";
            return Err(foreign_attribute(geom, "condim", reason));
        }
        let weighs = weighs && self.number(geom, class, "mass")?.or(self.number(geom, class, "density")?) != Some(0.0);
        let size = self.size(geom, class)?;
        let line = get("fromto")?.map(|text| exactly::<6>(geom, "fromto", text)).transpose()?;
        if line.is_some() && at.origin != Vector3::zeros() {
            return Err(foreign(geom, "both pos and fromto, of its own or of its class: only one of them is allowed"));
        }
        let needs = |n: usize, what: &str| {
            let reason = format!("size has {} numbers: {what}", size.len());
            if size.len() >= n { Ok(()) } else { Err(foreign(geom, reason)) }
        };
        let solid = match (get("type")?.unwrap_or("sphere"), line) {
            ("box", None) => {
                needs(3, "a box needs half of its three sides")?;
                Solid::Box { at, half: Vector3::new(size[0], size[1], size[2]) }
            }
            ("capsule", Some([ax, ay, az, bx, by, bz])) => {
                needs(1, "a capsule with fromto needs its radius")?;
                Solid::Capsule { ends: [Vector3::new(ax, ay, az), Vector3::new(bx, by, bz)], radius: size[0] }
            }
            ("capsule", None) => {
                needs(2, "a capsule needs its radius and half of its length")?;
                let half = Vector3::new(0.0, 0.0, size[1]);
                Solid::Capsule { ends: [at.point(-half), at.point(half)], radius: size[0] }
            }
            (_, _) if !collides && !weighs => return Ok(None),
            ("box", Some(_)) => return Err(foreign(geom, "a box with fromto: give its pos, size and quat instead")),
            (other, _) => {
                return Err(foreign(geom, format!("type = \"{other}\": only box and capsule are allowed")));
            }
        };
        if let Solid::Capsule { ends: [a, b], .. } = &solid
            && (b - a).norm() < 1e-6
        {
            return Err(foreign(geom, "a capsule of length 0: its ends must differ"));
        }
        Ok(Some(Geom { collides, solid }))
    }

    /// Returns the size of a geom. Where an element gives fewer numbers than its class, the class gives the rest.
    fn size(&self, geom: Node<'a, 'a>, class: &'a str) -> Result<Vec<f64>, Invalid> {
        let mut size = Vec::new();
        for text in self.defaults.all(geom, class, "size")? {
            let more = numbers(geom, "size", text)?;
            size.extend(more.into_iter().skip(size.len()));
        }
        Ok(size)
    }

    fn number(&self, geom: Node<'a, 'a>, class: &'a str, attribute: &str) -> Result<Option<f64>, Invalid> {
        let text = self.defaults.get(geom, class, attribute)?;
        text.map(|text| exactly::<1>(geom, attribute, text).map(|[v]| v)).transpose()
    }

    /// Returns mass and inertia of a geom, in its body's frame.
    pub(super) fn weight(&self, geom: Node<'a, 'a>, class: &'a str, solid: &Solid) -> Result<Lump, Invalid> {
        if let Some(text) = self.defaults.get(geom, class, "shellinertia")?
            && keyword(geom, "shellinertia", text, &["true", "false"])? == "true"
        {
            return Err(foreign(geom, "shellinertia = \"true\": only solid geoms are allowed"));
        }
        let density = self.number(geom, class, "density")?.unwrap_or(DENSITY);
        let mass = self.number(geom, class, "mass")?;
        let share = |volume: f64| mass.map_or(density, |mass| mass / volume);
        match solid {
            Solid::Box { at: Frame { rotation, origin }, half } => {
                let mass = share(8.0 * half.product()) * 8.0 * half.product();
                let square = half.component_mul(half);
                let moments =
                    Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y) * (mass / 3.0);
                let turn = rotation.to_rotation_matrix().into_inner();
                let inertia = turn * Matrix3::from_diagonal(&moments) * turn.transpose();
                Ok(Lump { mass, center: *origin, inertia })
            }
            Solid::Capsule { ends: [a, b], radius: r } => {
                let length = (b - a).norm();
                let (tube, ball) = (PI * r * r * length, 4.0 / 3.0 * PI * r * r * r);
                let density = share(tube + ball);
                let (tube, ball) = (tube * density, ball * density);
                let along = tube * r * r / 2.0 + ball * r * r * 0.4;
                let across = tube * (length * length / 12.0 + r * r / 4.0)
                    + ball * (0.4 * r * r + length * length / 4.0 + 0.375 * length * r);
                let axis = (b - a).normalize();
                let inertia = Matrix3::identity() * across + axis * axis.transpose() * (along - across);
                Ok(Lump { mass: tube + ball, center: (a + b) / 2.0, inertia })
            }
        }
    }
}
