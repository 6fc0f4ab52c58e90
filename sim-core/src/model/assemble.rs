//! Assembly of a robot file's modules in the neutral configuration: names, attachments, faces.

use super::kind::{FaceKind, ModuleKind};
use super::{Face, RobotSpec};
use crate::base::error::{Invalid, in_range, name, whole_in_range};
use crate::base::limits;
use crate::base::registry::Registered;
use nalgebra::{Matrix3, Vector3};

/// Rigid frame in f64. Rotations by quarter turns stay exact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

impl Frame {
    pub fn point(&self, p: [f64; 3]) -> Vector3<f64> {
        self.rotation * Vector3::from(p) + self.origin
    }

    pub fn direction(&self, d: [f64; 3]) -> Vector3<f64> {
        self.rotation * Vector3::from(d)
    }

    fn then(&self, inner: &Frame) -> Frame {
        Frame { rotation: self.rotation * inner.rotation, origin: self.rotation * inner.origin + self.origin }
    }

    fn inverse(&self) -> Frame {
        let rotation = self.rotation.transpose();
        Frame { rotation, origin: -(rotation * self.origin) }
    }

    /// Returns the frame of a face: x along its normal, z along its up direction.
    fn of_face(face: &FaceKind) -> Frame {
        let (x, z) = (Vector3::from(face.normal), Vector3::from(face.up));
        Frame { rotation: Matrix3::from_columns(&[x, z.cross(&x), z]), origin: Vector3::from(face.position) }
    }
}

/// Module placed in the neutral configuration.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub kind: &'static ModuleKind,
    pub frame: Frame,
    /// Rigid dock: the module's own part, and (module, part) of the carrier.
    pub dock: Option<(usize, (usize, usize))>,
    /// The docked faces: the carrier's, then its own.
    pub faces: Option<[Face; 2]>,
}

/// Returns sine and cosine: exact for multiples of 90°, otherwise from `libm`.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => {
            let radians = other.to_radians();
            (libm::sin(radians), libm::cos(radians))
        }
    }
}

fn rotation(axis: usize, degrees: f64) -> Matrix3<f64> {
    let (s, c) = sin_cos_degrees(degrees);
    match axis {
        0 => Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
        1 => Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c),
        _ => Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
    }
}

fn kind_of(field: &str, kind: &str) -> Result<&'static ModuleKind, Invalid> {
    ModuleKind::registry().find(kind).ok_or_else(|| Invalid::Unknown {
        field: format!("{field}.kind"),
        value: kind.to_owned(),
        known: ModuleKind::registry().names().into_iter().map(str::to_owned).collect(),
    })
}

fn face_of(field: String, kind: &'static ModuleKind, face: &str) -> Result<&'static FaceKind, Invalid> {
    kind.faces.iter().find(|p| p.name == face).ok_or_else(|| Invalid::Unknown {
        field,
        value: face.to_owned(),
        known: kind.faces.iter().map(|p| p.name.to_owned()).collect(),
    })
}

impl RobotSpec {
    /// Returns the index of the module called `module`.
    pub(super) fn module(&self, field: &str, module: &str) -> Result<usize, Invalid> {
        self.modules.iter().position(|m| m.name == module).ok_or_else(|| Invalid::Unknown {
            field: field.to_owned(),
            value: module.to_owned(),
            known: self.modules.iter().map(|m| m.name.clone()).collect(),
        })
    }

    /// Returns the pivot as (module, part).
    pub(super) fn pivot_part(&self) -> Result<(usize, usize), Invalid> {
        let (module, part) = match self.pivot.split_once('/') {
            Some((module, part)) => (module, Some(part)),
            None => (self.pivot.as_str(), None),
        };
        let index = self.module("robot.pivot", module)?;
        let kind = kind_of(&format!("robot.module[{index}]"), &self.modules[index].kind)?;
        let Some(part) = part else { return Ok((index, 0)) };
        match kind.parts.iter().position(|p| p.name == part) {
            Some(p) => Ok((index, p)),
            None => Err(Invalid::Unknown {
                field: "robot.pivot".into(),
                value: self.pivot.clone(),
                known: kind.parts.iter().map(|p| format!("{module}/{}", p.name)).collect(),
            }),
        }
    }

    fn check_names(&self) -> Result<(), Invalid> {
        name("robot.name", &self.name)?;
        whole_in_range("number of robot.module", self.modules.len() as u64, (1, limits::MAX_MODULES as u64), "")?;
        let length = self.description.len() as u64;
        whole_in_range("robot.description length", length, (0, limits::MAX_DESCRIPTION_LENGTH as u64), "bytes")?;
        for (i, module) in self.modules.iter().enumerate() {
            let field = format!("robot.module[{i}].name");
            name(&field, &module.name)?;
            if self.modules[..i].iter().any(|m| m.name == module.name) {
                return Err(Invalid::Duplicate { field, value: module.name.clone() });
            }
        }
        for (i, failed) in self.failed.iter().enumerate() {
            let field = format!("robot.failed[{i}]");
            let module = self.module(&field, failed)?;
            if kind_of(&format!("robot.module[{module}]"), &self.modules[module].kind)?.hinges.is_empty() {
                let reason = format!("module \"{failed}\" has no joint that could fail: remove it from the list");
                return Err(Invalid::Conflict { field, reason });
            }
        }
        for (variant, modules) in &self.variants {
            name("robot.variants", variant)?;
            for failed in modules {
                self.module(&format!("robot.variants.{variant}"), failed)?;
            }
        }
        Ok(())
    }

    /// Follows the attachments from module `i`. Returns an error if they lead back to it.
    fn check_loop(&self, i: usize, carriers: &[Option<usize>]) -> Result<(), Invalid> {
        let mut way = Vec::new();
        let mut at = i;
        while let Some(carrier) = carriers[at] {
            way.push(format!("\"{}\"", self.modules[carrier].name));
            if carrier == i {
                return Err(Invalid::AttachmentLoop {
                    module: self.modules[i].name.clone(), through: way.join(" → ")
                });
            }
            if way.len() > self.modules.len() {
                return Ok(()); // a loop without `i`: reported for one of its own modules
            }
            at = carrier;
        }
        Ok(())
    }

    /// Places all modules in the neutral configuration.
    pub(super) fn assemble(&self) -> Result<Vec<Placed>, Invalid> {
        self.check_names()?;
        let (pivot, _) = self.pivot_part()?;
        let mut carriers = Vec::new();
        let mut docks = Vec::new();
        for (i, module) in self.modules.iter().enumerate() {
            let field = format!("robot.module[{i}]");
            let kind = kind_of(&field, &module.kind)?;
            let Some(attach) = &module.attach else {
                carriers.push(None);
                docks.push((kind, None));
                continue;
            };
            if module.pose.is_some() {
                let reason = "an attached module has no pose of its own: remove `pose` or `attach`".to_owned();
                return Err(Invalid::Conflict { field: format!("{field}.pose"), reason });
            }
            let to = self.module(&format!("{field}.attach.to"), &attach.to)?;
            let carrier_kind = kind_of(&format!("robot.module[{to}]"), &self.modules[to].kind)?;
            let face = face_of(format!("{field}.attach.port"), carrier_kind, &attach.face)?;
            let own = match &attach.own {
                Some(own) => face_of(format!("{field}.attach.own"), kind, own)?,
                None => &kind.faces[0],
            };
            if ![0, 90, 180, 270].contains(&attach.turn) {
                return Err(Invalid::Unknown {
                    field: format!("{field}.attach.turn"),
                    value: attach.turn.to_string(),
                    known: ["0", "90", "180", "270"].map(str::to_owned).to_vec(),
                });
            }
            if !face.gender.fits(own.gender) {
                let reason = format!(
                    "face \"{}\" of module \"{}\" and face \"{}\" of module \"{}\" are both {}: one of them must be \
                     active, the other passive",
                    face.name,
                    attach.to,
                    own.name,
                    module.name,
                    face.gender.name()
                );
                return Err(Invalid::Conflict { field: format!("{field}.attach"), reason });
            }
            carriers.push(Some(to));
            docks.push((kind, Some((to, face, own, f64::from(attach.turn)))));
        }
        self.check_faces(&docks)?;
        for i in 0..self.modules.len() {
            self.check_loop(i, &carriers)?;
        }
        let root = |mut i: usize| {
            while let Some(carrier) = carriers[i] {
                i = carrier;
            }
            i
        };
        if let Some(i) = (0..self.modules.len()).find(|&i| root(i) != root(pivot)) {
            return Err(Invalid::Disconnected {
                module: self.modules[i].name.clone(),
                pivot: self.modules[pivot].name.clone(),
            });
        }
        self.place(&docks)
    }

    fn check_faces(&self, docks: &[(&'static ModuleKind, Option<Dock>)]) -> Result<(), Invalid> {
        let mut taken: Vec<(usize, &str, usize)> = Vec::new();
        for (i, (_, dock)) in docks.iter().enumerate() {
            let Some((to, face, own, _)) = dock else { continue };
            for (module, name) in [(*to, face.name), (i, own.name)] {
                if let Some(&(_, _, by)) = taken.iter().find(|t| t.0 == module && t.1 == name) {
                    return Err(Invalid::FaceTaken {
                        field: format!("robot.module[{i}].attach"),
                        face: name.to_owned(),
                        module: self.modules[module].name.clone(),
                        by: self.modules[by].name.clone(),
                    });
                }
            }
            taken.push((*to, face.name, i));
            taken.push((i, own.name, *to));
        }
        Ok(())
    }

    fn place(&self, docks: &[(&'static ModuleKind, Option<Dock>)]) -> Result<Vec<Placed>, Invalid> {
        let mut placed: Vec<Option<Placed>> = vec![None; docks.len()];
        // Attachments may point forward, so several passes may be needed. There is no loop, so every pass places a
        // module.
        while placed.iter().any(Option::is_none) {
            for (i, (kind, dock)) in docks.iter().enumerate() {
                if placed[i].is_some() {
                    continue;
                }
                placed[i] = match dock {
                    None => Some(Placed { kind, frame: self.root_frame(i)?, dock: None, faces: None }),
                    Some((to, face, own, turn)) => placed[*to].as_ref().map(|carrier| {
                        let flip = Frame { rotation: rotation(2, 180.0), origin: Vector3::zeros() };
                        let turn = Frame { rotation: rotation(0, *turn), origin: Vector3::zeros() };
                        let docked = Frame::of_face(face).then(&turn).then(&flip).then(&Frame::of_face(own).inverse());
                        let index = |kind: &ModuleKind, face: &FaceKind| {
                            kind.faces.iter().position(|f| f.name == face.name).expect("the face is of this kind")
                        };
                        let faces = [
                            Face { module: *to, face: index(carrier.kind, face) },
                            Face { module: i, face: index(kind, own) },
                        ];
                        Placed {
                            kind,
                            frame: carrier.frame.then(&docked),
                            dock: Some((own.part, (*to, face.part))),
                            faces: Some(faces),
                        }
                    }),
                };
            }
        }
        Ok(placed.into_iter().flatten().collect())
    }

    fn root_frame(&self, i: usize) -> Result<Frame, Invalid> {
        let pose = self.modules[i].pose.as_ref();
        let (position, turns) = pose.map_or(([0.0; 3], [0.0; 3]), |p| (p.position, p.rotation));
        for axis in 0..3 {
            let at = |what: &str| format!("robot.module[{i}].pose.{what}[{axis}]");
            in_range(at("position"), position[axis], (-1000.0, 1000.0), "mu")?;
            in_range(at("rotation"), turns[axis], (-360.0, 360.0), "degrees")?;
        }
        let rotation = rotation(0, turns[0]) * rotation(1, turns[1]) * rotation(2, turns[2]);
        Ok(Frame { rotation, origin: Vector3::from(position) })
    }
}

/// Dock of a module: (carrier, its face, own face, turn in degrees).
type Dock = (usize, &'static FaceKind, &'static FaceKind, f64);
