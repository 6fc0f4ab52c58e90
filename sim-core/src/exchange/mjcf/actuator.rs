//! Actuators: which joints have a motor, and the ranges of their servos. Kinds and gains of motors come from the job.

use super::defaults::MAIN;
use super::read::Reader;
use crate::base::error::Invalid;
use crate::exchange::source::{children, exactly, foreign, keyword, quarter_turns, tag};
use roxmltree::Node;
use std::f64::consts::FRAC_PI_2;

/// Allowed deviation of a range from a right angle, rad.
const NEAR: f64 = 1e-3;

impl<'a> Reader<'a> {
    /// Reads the actuators. If there are any, each hinge must have one, and its targets must reach from −90° to 90°. A
    /// hinge without limits takes those of its servo.
    pub(super) fn actuators(&mut self, mujoco: Node<'a, 'a>) {
        let mut driven = Vec::new();
        let mut limited = Vec::new();
        for actuator in children(mujoco).filter(|s| tag(*s) == "actuator").flat_map(children) {
            let Some(name) = actuator.attribute("joint").or(actuator.attribute("jointinparent")) else {
                continue; // refused by the schema, or without effect
            };
            let hinges = self.links.iter().filter_map(|link| link.hinge.as_ref());
            let Some(joint) = hinges.map(|h| h.element).find(|j| j.attribute("name") == Some(name)) else {
                let reason = format!("joint = \"{name}\" is not a hinge of the robot: name one of its hinges");
                self.faults.add(foreign(actuator, reason));
                continue;
            };
            driven.push(joint);
            let range = self.servo_range(actuator, joint);
            if let Some(Some([low, high])) = self.faults.take(range) {
                if self.unlimited.contains(&joint) && (low + FRAC_PI_2).abs() < NEAR && (high - FRAC_PI_2).abs() < NEAR
                {
                    limited.push(joint);
                } else if low > -FRAC_PI_2 + NEAR || high < FRAC_PI_2 - NEAR {
                    let reason = format!(
                        "its targets go from {:.1}° to {:.1}°: they must reach from -90° to 90°",
                        low.to_degrees(),
                        high.to_degrees()
                    );
                    self.faults.add(foreign(actuator, reason));
                }
            }
        }
        for joint in self.unlimited.iter().filter(|joint| !limited.contains(joint)) {
            let _ = self.faults.take(quarter_turns(*joint, None));
        }
        let passive = |element: &&Node<'a, 'a>| !driven.contains(element);
        let hinges: Vec<Node> = self.links.iter().filter_map(|link| Some(link.hinge.as_ref()?.element)).collect();
        if driven.is_empty() {
            return;
        }
        for joint in hinges.iter().filter(passive) {
            let reason = "it has no actuator, but other hinges have one: give one to every hinge, or to none";
            self.faults.add(foreign(*joint, reason));
        }
    }

    /// Returns the joint angles, rad, between which a servo's control can move. `None` for other motors and for servos
    /// without limits.
    fn servo_range(&self, actuator: Node<'a, 'a>, joint: Node<'a, 'a>) -> Result<Option<[f64; 2]>, Invalid> {
        let get = |attribute: &str| self.defaults.get(actuator, MAIN, attribute);
        let gear = match get("gear")? {
            Some(text) => crate::exchange::source::numbers(actuator, "gear", text)?,
            None => vec![1.0],
        };
        let gear = gear.first().copied().unwrap_or(1.0);
        if gear == 0.0 {
            return Err(foreign(actuator, "gear = \"0\": the actuator has no effect; another gear is needed"));
        }
        let servo = match tag(actuator) {
            "position" => true,
            "general" => get("biastype")? == Some("affine"),
            _ => false,
        };
        if !servo {
            return Ok(None);
        }
        if let Some(text) = get("inheritrange")? {
            let [share] = exactly(actuator, "inheritrange", text)?;
            if share > 0.0 && self.unlimited.contains(&joint) {
                return Err(foreign(
                    actuator,
                    "inheritrange: its joint has no range; give it one, or give ctrlrange instead",
                ));
            }
            if share > 0.0 {
                return Ok(Some([-FRAC_PI_2 * share, FRAC_PI_2 * share]));
            }
        }
        let range = get("ctrlrange")?.map(|text| exactly::<2>(actuator, "ctrlrange", text)).transpose()?;
        let limited = match get("ctrllimited")? {
            Some(text) => keyword(actuator, "ctrllimited", text, &["true", "false", "auto"])?,
            None => "auto",
        };
        let limited = match limited {
            "auto" => self.compiler.autolimits && range.is_some(),
            other => other == "true",
        };
        Ok(range.filter(|_| limited).map(|[low, high]| match gear > 0.0 {
            true => [low / gear, high / gear],
            false => [high / gear, low / gear],
        }))
    }
}
