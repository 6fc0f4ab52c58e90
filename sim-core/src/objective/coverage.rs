//! Coverage: the share of a map's cells that a tree reaches.

use super::{Centers, Objective, ObjectiveKind};
use crate::base::error::{Invalid, in_range, whole_in_range};
use crate::base::limits;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::environment::{Block, Environment};
use crate::plan::Tree;

/// Share of the map's cells that hold a node, percent. Maximised.
pub struct Coverage;

/// Side of a cell.
pub const CELL: Setting = Setting::real("cell", "mu", 2.0).within(0.01, limits::MAX_MAP_SIZE);
/// Number of dimensions: 2 counts squares of the map, 3 counts cubes of the space above it up to the height.
const DIMENSIONS: Setting = Setting::whole("dimensions", 2).within(2.0, 3.0);
/// Height of the counted space in three dimensions, at least one cell. Default: one cell above the highest terrain.
const HEIGHT: Setting = Setting::optional_real("height", "mu");

impl Component for Coverage {
    fn name(&self) -> &'static str {
        "coverage"
    }
}

impl Configurable for Coverage {
    fn settings(&self) -> &'static [Setting] {
        &[CELL, DIMENSIONS, HEIGHT]
    }
}

impl ObjectiveKind for Coverage {
    /// Returns 2 in three dimensions: there the cell that is not counted is that of the settled pivot, not the one on
    /// the ground below it. Returns 1 in two dimensions.
    fn revision_with(&self, settings: &Settings) -> u32 {
        if settings.whole(&DIMENSIONS) == 3 { 2 } else { 1 }
    }

    fn validate(&self, settings: &Settings, environment: &Environment) -> Result<(), Invalid> {
        Grid::counts(settings, environment).map(|_| ())
    }

    fn direction(&self) -> Direction {
        Direction::Maximise
    }

    fn label(&self) -> (&'static str, &'static str) {
        ("coverage", "%")
    }

    fn range(&self) -> (f64, f64) {
        (0.0, 100.0)
    }

    fn prepare(
        &self,
        settings: &Settings,
        environment: &Environment,
        start: f64,
    ) -> Result<Box<dyn Objective>, Invalid> {
        Ok(Box::new(Grid::new(settings, environment, start)?))
    }
}

/// Cells of a coverage: a grid from the map's lower corner. The map's border cuts the last row and column.
///
/// Cells wholly inside one obstacle, or in three dimensions one piece of terrain, can't be reached and are left out.
/// The start's own cell is not counted, so robots that do not move score 0.
#[derive(Debug)]
struct Grid {
    cell: f64,
    corner: [f64; 2],
    counts: [usize; 3],
    counted: Vec<bool>,
    total: usize,
}

impl Grid {
    /// Creates the grid of an environment. `start` is the height of the pivot at the start, mu.
    fn new(settings: &Settings, environment: &Environment, start: f64) -> Result<Self, Invalid> {
        let counts = Self::counts(settings, environment)?;
        let (cell, dimensions) = (settings.real(&CELL), settings.whole(&DIMENSIONS));
        let cells = counts.iter().product();
        let [width, depth] = environment.size;
        let corner = [-width / 2.0, -depth / 2.0];
        let mut grid = Self { cell, corner, counts, counted: vec![true; cells], total: 0 };
        let solids: Vec<&Block> = match dimensions {
            3 => environment.obstacles.iter().chain(&environment.terrain).collect(),
            _ => environment.obstacles.iter().collect(),
        };
        for block in solids {
            let (columns, rows) = (grid.around(block, 0), grid.around(block, 1));
            for (layer, row) in (0..counts[2]).flat_map(|layer| rows.clone().map(move |row| (layer, row))) {
                for i in columns.clone().map(|column| (layer * counts[1] + row) * counts[0] + column) {
                    grid.counted[i] = grid.counted[i] && !grid.inside(i, block, dimensions == 3, environment);
                }
            }
        }
        if let Some(start) = grid.index(environment.start.x, environment.start.y, start) {
            grid.counted[start] = false;
        }
        grid.total = grid.counted.iter().filter(|c| **c).count();
        if grid.total == 0 {
            let reason = "no cell is left to cover: choose smaller cells".to_owned();
            return Err(Invalid::Conflict { field: "fitness.cell".into(), reason });
        }
        Ok(grid)
    }

    /// Returns the numbers of cells along x, y and z.
    fn counts(settings: &Settings, environment: &Environment) -> Result<[usize; 3], Invalid> {
        let (cell, height) = (settings.real(&CELL), settings.optional(&HEIGHT));
        let [width, depth] = environment.size;
        let along = |side: f64| libm::ceil(side / cell - 1e-9).max(1.0) as usize;
        let layers = if settings.whole(&DIMENSIONS) == 3 {
            let top = environment.terrain.iter().map(|t| t.top).fold(0.0, f64::max);
            let height = height.unwrap_or(top + cell);
            in_range("fitness.height", height, (cell, limits::MAX_MAP_SIZE), "mu")?;
            along(height)
        } else {
            if height.is_some() {
                let reason = "a height needs dimensions = 3: set it, or leave the height out".to_owned();
                return Err(Invalid::Conflict { field: "fitness.height".into(), reason });
            }
            1
        };
        let counts = [along(width), along(depth), layers];
        let cells = counts.iter().try_fold(1usize, |n, &c| n.checked_mul(c)).unwrap_or(usize::MAX);
        whole_in_range("number of cells (fitness.cell)", cells as u64, (1, limits::MAX_CELLS as u64), "")?;
        Ok(counts)
    }

    /// Returns the range of cells along an axis (0: x, 1: y) that a block can cover.
    fn around(&self, block: &Block, axis: usize) -> std::ops::Range<usize> {
        let [a, b] = block.size;
        let reach = (a * a + b * b).sqrt() / 2.0 + self.cell;
        let at =
            |offset: f64| libm::floor((block.center[axis] + offset - self.corner[axis]) / self.cell).max(0.0) as usize;
        at(-reach).min(self.counts[axis])..(at(reach) + 1).min(self.counts[axis])
    }

    /// Returns the index of a point's cell; `None` outside the grid. Points on the map's upper border belong to the
    /// last cell.
    fn index(&self, x: f64, y: f64, z: f64) -> Option<usize> {
        let along = |offset: f64, axis: usize| {
            let i = libm::floor(offset / self.cell);
            let border = offset <= self.counts[axis] as f64 * self.cell;
            (i >= 0.0 && border).then(|| (i as usize).min(self.counts[axis] - 1))
        };
        let (i, j) = (along(x - self.corner[0], 0)?, along(y - self.corner[1], 1)?);
        let k = if self.counts[2] == 1 { 0 } else { along(z.max(0.0), 2)? };
        Some((k * self.counts[1] + j) * self.counts[0] + i)
    }

    /// Returns true if a cell, cut by the map, lies wholly inside a block. With `solid`, heights are compared too.
    fn inside(&self, index: usize, block: &Block, solid: bool, environment: &Environment) -> bool {
        let (i, rest) = (index % self.counts[0], index / self.counts[0]);
        let (j, k) = (rest % self.counts[1], rest / self.counts[1]);
        let edge = |n: usize, axis: usize| (self.corner[axis] + n as f64 * self.cell).min(environment.size[axis] / 2.0);
        let flat = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)]
            .iter()
            .all(|&(i, j)| block.covers(edge(i, 0), edge(j, 1), 1e-9));
        let (low, high) = (k as f64 * self.cell, (k + 1) as f64 * self.cell);
        flat && (!solid || (block.base <= low && block.top >= high))
    }
}

impl Objective for Grid {
    /// Returns the percentage of the counted cells that hold a node.
    fn score(&self, tree: &Tree, _: &Centers<'_>) -> f64 {
        // Zeroed memory costs nothing until it is touched, so the time grows with the nodes and not with the cells.
        let mut covered = vec![false; self.counted.len()];
        let mut count = 0;
        for node in &tree.nodes {
            if let Some(i) = self.index(node.place.x, node.place.y, node.place.z) {
                let fresh = !std::mem::replace(&mut covered[i], true);
                count += usize::from(fresh && self.counted[i]);
            }
        }
        100.0 * count as f64 / self.total as f64
    }
}
