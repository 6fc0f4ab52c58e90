//! Isometric view of a robot from above, from its front right.
//!
//! 1 mu has the same length along x, y and z, so one scale is enough.

use super::Picture;
use super::canvas::{Anchor, Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{FAINT, GRID, INK, series};
use super::picture::{fitted, width};

const WIDTH: f64 = 760.0;
/// Largest size of the robot, px.
const ROOM: [f64; 2] = [WIDTH - 100.0, 430.0];
/// Largest scale, px per mu, so that a robot of one module does not fill the sheet.
const MOST_SCALE: f64 = 110.0;
const FAILED: &str = "#b3001b";

/// Box-shaped part of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnBox {
    /// Centre (x, y, z), mu.
    pub center: [f64; 3],
    /// Rotation as a unit quaternion (x, y, z, w).
    pub rotation: [f64; 4],
    /// Half side lengths along its own axes, mu.
    pub half: [f64; 3],
    /// Corners (x, y) of a convex outline within the box, counter-clockwise and relative to the centre, mu, for a prism
    /// along z; `None` for the box itself.
    pub outline: Option<Vec<[f64; 2]>>,
    /// Name of the box's module, or of its body for robots made of bodies. Boxes with the same name have one colour.
    pub module: String,
    /// True if the module has failed.
    pub failed: bool,
}

/// Draws the boxes at their places, with one colour per module, names on the modules, and failed modules hatched in
/// red. Arrows along the axes show the scale.
pub fn robot(boxes: &[DrawnBox], title: &str, subtitle: &str) -> Picture {
    let mut canvas = Canvas::new();
    let mut modules: Vec<&str> = Vec::new();
    for b in boxes {
        if !modules.contains(&b.module.as_str()) {
            modules.push(&b.module);
        }
    }
    let top = heading(&mut canvas, title, subtitle, WIDTH);
    canvas.raw(&format!(
        "<defs><pattern id=\"failed\" patternUnits=\"userSpaceOnUse\" width=\"8\" height=\"8\" \
         patternTransform=\"rotate(45)\"><rect width=\"8\" height=\"8\" fill=\"#ffffff\"/>\
         <rect width=\"2.5\" height=\"8\" fill=\"{FAILED}\"/></pattern></defs>"
    ));
    let failed_key =
        Key::area("failed: its joint is stuck at zero", format!("fill=\"url(#failed)\" {}", stroke(FAILED, 1.0)));
    let keys = if boxes.iter().any(|b| b.failed) { vec![failed_key] } else { Vec::new() };
    let top = legend(&mut canvas, &keys, top, WIDTH) + 8.0;

    let solids: Vec<Solid> =
        boxes.iter().filter_map(|b| Solid::of(b, modules.iter().position(|m| *m == b.module)?)).collect();
    let ground = Ground::below(&solids);
    let view = View::fitting(&solids, top);
    if let Some(ground) = &ground {
        // Clips the grid: its corners may lie outside the drawing area.
        canvas.raw(&format!(
            "<clipPath id=\"ground\"><rect x=\"24\" y=\"{top}\" width=\"{}\" height=\"{}\"/></clipPath>\
             <g clip-path=\"url(#ground)\">",
            WIDTH - 48.0,
            ROOM[1]
        ));
        draw_ground(&mut canvas, &view, ground);
        canvas.raw("</g>");
    }
    for i in back_to_front(&solids) {
        draw(&mut canvas, &view, &solids[i]);
    }
    names(&mut canvas, &view, &solids, &modules);
    let bottom = top + ROOM[1];
    if solids.is_empty() {
        let middle = [WIDTH / 2.0, top + ROOM[1] / 2.0];
        let style = Type { size: 15.0, ..Type::LABEL }.coloured(FAINT).anchored(Anchor::Middle);
        canvas.text(middle, "no data: the robot has no parts", style);
    } else {
        axes_hint(&mut canvas, view.scale, [70.0, bottom + 92.0]);
    }
    let height = (bottom + 150.0).ceil();
    Picture::new(canvas.finish(WIDTH, height), WIDTH as u32, height as u32)
}

type Point = [f64; 3];

/// Direction to the viewer; its length does not matter.
const TO_VIEWER: Point = [1.0, -1.0, 1.0];
/// Direction to the light.
const TO_LIGHT: Point = [0.35, -0.6, 0.72];

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Box with its axes scaled by its sizes.
struct Solid {
    center: Point,
    /// Axes of the box, each with the length of half a side.
    axes: [Point; 3],
    /// Corners of a prism's outline in units of half sides; `None` for a box.
    outline: Option<Vec<[f64; 2]>>,
    module: usize,
    failed: bool,
}

impl Solid {
    /// Converts a box; `None` if a number is not finite or too large, or if a size is not positive.
    fn of(b: &DrawnBox, module: usize) -> Option<Self> {
        let numbers = b.center.iter().chain(&b.rotation).chain(&b.half);
        if numbers.clone().any(|v| !v.is_finite() || v.abs() > 1e6) || b.half.iter().any(|h| *h <= 0.0) {
            return None;
        }
        let [x, y, z, w] = b.rotation;
        let length = (x * x + y * y + z * z + w * w).sqrt();
        let [x, y, z, w] = if length > 1e-9 { [x, y, z, w].map(|c| c / length) } else { [0.0, 0.0, 0.0, 1.0] };
        let axes = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let scaled = |i: usize| axes[i].map(|c| c * b.half[i]);
        let outline =
            b.outline.as_ref().map(|corners| corners.iter().map(|c| [c[0] / b.half[0], c[1] / b.half[1]]).collect());
        Some(Self { center: b.center, axes: [scaled(0), scaled(1), scaled(2)], outline, module, failed: b.failed })
    }

    /// Returns the point at (u, v, w) in units of half sides.
    fn point(&self, uvw: Point) -> Point {
        let along = |k: usize| self.center[k] + (0..3).map(|i| uvw[i] * self.axes[i][k]).sum::<f64>();
        [along(0), along(1), along(2)]
    }

    fn corners(&self) -> Vec<Point> {
        if let Some(outline) = &self.outline {
            return [-1.0, 1.0].iter().flat_map(|z| outline.iter().map(|[x, y]| self.point([*x, *y, *z]))).collect();
        }
        let sign = |i: usize, bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        (0..8).map(|i| self.point([sign(i, 0), sign(i, 1), sign(i, 2)])).collect()
    }

    /// Returns the faces: an outward normal, and the corners in order around the face.
    fn faces(&self) -> Vec<(Point, Vec<Point>)> {
        match &self.outline {
            Some(outline) => self.prism_faces(outline),
            None => self.box_faces().collect(),
        }
    }

    fn prism_faces(&self, outline: &[[f64; 2]]) -> Vec<(Point, Vec<Point>)> {
        let end = |z: f64| {
            let corners = outline.iter().map(|[x, y]| self.point([*x, *y, z])).collect();
            (self.axes[2].map(|c| c * z), corners)
        };
        let side = |i: usize| {
            let ([ax, ay], [bx, by]) = (outline[i], outline[(i + 1) % outline.len()]);
            // The axes are orthogonal, so the normal of the edge from a to b is its direction turned by a quarter.
            let length = |axis: usize| dot(self.axes[axis], self.axes[axis]);
            let (u, v) = ((by - ay) / length(0), (ax - bx) / length(1));
            let normal = std::array::from_fn(|k| u * self.axes[0][k] + v * self.axes[1][k]);
            let corners = [[ax, ay, -1.0], [bx, by, -1.0], [bx, by, 1.0], [ax, ay, 1.0]];
            (normal, corners.map(|uvw| self.point(uvw)).to_vec())
        };
        [end(-1.0), end(1.0)].into_iter().chain((0..outline.len()).map(side)).collect()
    }

    fn box_faces(&self) -> impl Iterator<Item = (Point, Vec<Point>)> {
        (0..6).map(|f| {
            let (axis, sign) = (f / 2, if f % 2 == 0 { 1.0 } else { -1.0 });
            let corner = |a: f64, b: f64| {
                let mut uvw = [0.0; 3];
                (uvw[axis], uvw[(axis + 1) % 3], uvw[(axis + 2) % 3]) = (sign, a, b);
                self.point(uvw)
            };
            let normal = self.axes[axis].map(|c| c * sign);
            (normal, vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
        })
    }

    /// Returns `Some(true)` if a face of this box proves that the other box is in front of it, `Some(false)` if a face
    /// proves that the other box is behind it.
    fn tells(&self, other: &Self) -> Option<bool> {
        self.faces().into_iter().find_map(|(normal, corners)| {
            let length = dot(normal, normal).sqrt();
            let beyond = |p: Point| (dot(normal, p) - dot(normal, corners[0])) / length >= -1e-3;
            let towards = dot(normal, TO_VIEWER) / length;
            (towards.abs() > 1e-6 && other.corners().into_iter().all(beyond)).then_some(towards > 0.0)
        })
    }

    fn hides(&self, other: &Self) -> bool {
        other.tells(self).or_else(|| self.tells(other).map(|in_front| !in_front)).unwrap_or(false)
    }
}

/// Returns the painter's order: each box comes after the boxes that it may hide. If boxes hide each other in a cycle,
/// or overlap in space, the farthest one comes first.
fn back_to_front(solids: &[Solid]) -> Vec<usize> {
    let flat: Vec<[f64; 4]> = solids.iter().map(|s| bounds(s.corners().into_iter().map(project))).collect();
    let apart = |a: &[f64; 4], b: &[f64; 4]| a[1] <= b[0] || b[1] <= a[0] || a[3] <= b[2] || b[3] <= a[2];
    let hidden_by = |i: usize, j: usize| i != j && !apart(&flat[i], &flat[j]) && solids[i].hides(&solids[j]);
    // behind[i]: boxes to be drawn before box i.
    let mut behind: Vec<Vec<usize>> =
        (0..solids.len()).map(|i| (0..solids.len()).filter(|&j| hidden_by(i, j)).collect()).collect();
    let mut left: Vec<usize> = (0..solids.len()).collect();
    left.sort_by(|&a, &b| dot(solids[a].center, TO_VIEWER).total_cmp(&dot(solids[b].center, TO_VIEWER)));
    let mut order = Vec::with_capacity(left.len());
    while !left.is_empty() {
        let next = left.remove(left.iter().position(|&i| behind[i].is_empty()).unwrap_or(0));
        behind.iter_mut().for_each(|b| b.retain(|&j| j != next));
        order.push(next);
    }
    order
}

/// Projects a point to isometric coordinates in mu: (right, down).
fn project([x, y, z]: Point) -> [f64; 2] {
    let (half, sixth) = (0.5f64.sqrt(), (1.0f64 / 6.0).sqrt());
    [(x + y) * half, (x - y - 2.0 * z) * sixth]
}

/// Returns least x, greatest x, least y, greatest y.
fn bounds(points: impl Iterator<Item = [f64; 2]>) -> [f64; 4] {
    let none = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    points.fold(none, |b, [x, y]| [b[0].min(x), b[1].max(x), b[2].min(y), b[3].max(y)])
}

/// Ground below the robot, extended to whole mu.
struct Ground {
    x: (f64, f64),
    y: (f64, f64),
    floor: f64,
}

impl Ground {
    /// Returns the ground; `None` without a robot, or if the robot is so large that a grid of 1 mu would look grey.
    fn below(solids: &[Solid]) -> Option<Self> {
        let corners = || solids.iter().flat_map(Solid::corners);
        let [x0, x1, y0, y1] = bounds(corners().map(|c| [c[0], c[1]]));
        let floor = corners().map(|c| c[2]).fold(f64::INFINITY, f64::min);
        let around = |low: f64, high: f64| ((low - 0.25).floor(), (high + 0.25).ceil());
        let sane = !solids.is_empty() && x1 - x0 <= 60.0 && y1 - y0 <= 60.0;
        sane.then(|| Self { x: around(x0, x1), y: around(y0, y1), floor })
    }
}

/// Mapping from mu to px.
struct View {
    scale: f64,
    offset: [f64; 2],
}

impl View {
    fn fitting(solids: &[Solid], top: f64) -> Self {
        if solids.is_empty() {
            return Self { scale: 1.0, offset: [0.0; 2] };
        }
        let [x0, x1, y0, y1] = bounds(solids.iter().flat_map(Solid::corners).map(project));
        let scale = (ROOM[0] / (x1 - x0)).min((ROOM[1] - 30.0) / (y1 - y0)).min(MOST_SCALE);
        let offset = [WIDTH / 2.0 - (x0 + x1) / 2.0 * scale, top + ROOM[1] / 2.0 - (y0 + y1) / 2.0 * scale];
        Self { scale, offset }
    }

    fn at(&self, point: Point) -> [f64; 2] {
        let [x, y] = project(point);
        [self.offset[0] + x * self.scale, self.offset[1] + y * self.scale]
    }
}

/// Draws a grid of 1 mu below the robot.
fn draw_ground(canvas: &mut Canvas, view: &View, ground: &Ground) {
    let Ground { x: (x0, x1), y: (y0, y1), floor } = *ground;
    let steps = |from: f64, to: f64| (0..=(to - from) as usize).map(move |i| from + i as f64);
    let along_y = steps(x0, x1).map(|x| vec![view.at([x, y0, floor]), view.at([x, y1, floor])]);
    let along_x = steps(y0, y1).map(|y| vec![view.at([x0, y, floor]), view.at([x1, y, floor])]);
    canvas.polylines(&along_y.chain(along_x).collect::<Vec<_>>(), &stroke(GRID, 1.0));
}

fn draw(canvas: &mut Canvas, view: &View, solid: &Solid) {
    for (normal, corners) in solid.faces().into_iter().filter(|(n, _)| dot(*n, TO_VIEWER) > 0.0) {
        let outline: Vec<[f64; 2]> = corners.into_iter().map(|c| view.at(c)).collect();
        let light = (dot(normal, TO_LIGHT) / dot(normal, normal).sqrt()).max(0.0);
        let edge = format!("{} stroke-linejoin=\"round\"", stroke(INK, 1.1));
        if solid.failed {
            canvas.polygon(&outline, "fill=\"url(#failed)\"");
            canvas.polygon(&outline, &format!("fill=\"#000000\" fill-opacity=\"{:.2}\" {edge}", 0.3 * (1.0 - light)));
        } else {
            canvas.polygon(&outline, &format!("{} {edge}", fill(&lit(series(solid.module), light))));
        }
    }
}

/// Returns a paler shade of a colour, so that edges and names are visible; more light makes it brighter.
fn lit(colour: &str, light: f64) -> String {
    let channel = |i: usize| u8::from_str_radix(&colour[i..i + 2], 16).map_or(128.0, f64::from);
    let shade = 0.62 + 0.38 * light;
    let mixed = |c: f64| ((0.72 * c + 0.28 * 255.0) * shade).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(channel(1)), mixed(channel(3)), mixed(channel(5)))
}

/// Writes names on top of the modules, nearest first. A name that would overlap another is omitted.
fn names(canvas: &mut Canvas, view: &View, solids: &[Solid], modules: &[&str]) {
    let style = Type { size: 12.0, ..Type::LABEL }.bold().anchored(Anchor::Middle).halo();
    let mut places: Vec<(f64, usize, [f64; 2])> = Vec::new();
    for i in 0..modules.len() {
        let own: Vec<&Solid> = solids.iter().filter(|s| s.module == i).collect();
        if own.is_empty() {
            continue;
        }
        let mean = |k: usize| own.iter().map(|s| s.center[k]).sum::<f64>() / own.len() as f64;
        let top = own.iter().flat_map(|s| s.corners()).map(|c| c[2]).fold(f64::NEG_INFINITY, f64::max);
        let place = [mean(0), mean(1), top];
        places.push((dot(place, TO_VIEWER), i, view.at(place)));
    }
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut taken: Vec<[f64; 4]> = Vec::new();
    for (_, i, [x, y]) in places {
        let name = fitted(modules[i], style, 110.0);
        let half = width(&name, style) / 2.0 + 3.0;
        let room = [x - half, x + half, y - 9.0, y + 9.0];
        if taken.iter().all(|t| room[1] <= t[0] || t[1] <= room[0] || room[3] <= t[2] || t[3] <= room[2]) {
            taken.push(room);
            canvas.text([x, y + 4.0], &name, style);
        }
    }
}

/// Draws arrows along x, y and z. Their length is a round number of mu, which is written beside them.
fn axes_hint(canvas: &mut Canvas, scale: f64, origin: [f64; 2]) {
    let foreshortening = (2.0f64 / 3.0).sqrt();
    let long_enough = |l: &f64| l * scale * foreshortening >= 30.0;
    let length = (0..20).flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e))).find(long_enough).unwrap_or(1.0);
    let tip = |p: Point| {
        let [x, y] = project(p);
        [origin[0] + x * scale, origin[1] + y * scale]
    };
    let style = Type::LABEL.bold().anchored(Anchor::Middle);
    for (name, end) in [("x", [length, 0.0, 0.0]), ("y", [0.0, length, 0.0]), ("z", [0.0, 0.0, length])] {
        let to = tip(end);
        canvas.arrow(origin, to, 1.8, INK);
        let (dx, dy) = (to[0] - origin[0], to[1] - origin[1]);
        let reach = dx.hypot(dy);
        canvas.text([to[0] + dx / reach * 11.0, to[1] + dy / reach * 11.0 + 4.5], name, style);
    }
    let beside = [tip([length, 0.0, 0.0])[0].max(origin[0] + 40.0) + 30.0, origin[1] + 4.5];
    canvas.text(beside, &format!("each arrow is {length} mu long"), Type::TICK.coloured(FAINT));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(center: Point, half: Point) -> Solid {
        let rotation = [0.0, 0.0, 0.0, 1.0];
        Solid::of(&DrawnBox { center, rotation, half, outline: None, module: String::new(), failed: false }, 0).unwrap()
    }

    /// In a block of cubes in shuffled order, each cube is drawn after the cubes behind, below and to the left of it.
    #[test]
    fn cubes_are_drawn_from_back_to_front() {
        let places: Vec<Point> =
            (0..27).map(|i| i * 10 % 27).map(|i| [f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)]).collect();
        let solids: Vec<Solid> = places.iter().map(|p| solid(*p, [0.5; 3])).collect();
        let order = back_to_front(&solids);
        let turn = |i: usize| order.iter().position(|o| *o == i).unwrap();
        for (i, a) in places.iter().enumerate() {
            for (j, b) in places.iter().enumerate() {
                if i != j && a[0] <= b[0] && a[1] >= b[1] && a[2] <= b[2] {
                    assert!(turn(i) < turn(j), "{a:?} must be drawn before {b:?}");
                }
            }
        }
        assert_eq!(
            {
                let mut sorted = order;
                sorted.sort_unstable();
                sorted
            },
            (0..27).collect::<Vec<_>>()
        );
    }

    /// An order by centres would be wrong: the plate's centre is nearer to the viewer than the centre of the cube on
    /// it.
    #[test]
    fn cube_on_long_plate_is_drawn_after_plate() {
        let (plate, cube) = (solid([0.0, 0.0, 0.0], [5.0, 5.0, 0.1]), solid([-4.0, 4.0, 0.6], [0.5; 3]));
        assert!(dot(plate.center, TO_VIEWER) > dot(cube.center, TO_VIEWER));
        assert_eq!(back_to_front(&[plate, cube]), [0, 1]);
        let (plate, cube) = (solid([0.0, 0.0, 0.0], [5.0, 5.0, 0.1]), solid([-4.0, 4.0, 0.6], [0.5; 3]));
        assert_eq!(back_to_front(&[cube, plate]), [1, 0]);
    }

    /// 1 mu has the same drawn length along each axis, and z points up.
    #[test]
    fn projection_is_isometric() {
        let length = |p: Point| project(p)[0].hypot(project(p)[1]);
        let lengths = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(length);
        assert!(lengths.iter().all(|l| (l - (2.0f64 / 3.0).sqrt()).abs() < 1e-12));
        assert!(project([0.0, 0.0, 1.0])[1] < 0.0 && project(TO_VIEWER).iter().all(|v| v.abs() < 1e-12));
    }
}
