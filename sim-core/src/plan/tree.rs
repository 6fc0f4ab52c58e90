//! Tree of configurations.

use crate::model::Place;

/// A configuration that the robot can reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// The pivot's place.
    pub place: Place,
    /// Indexes of the parent node and of the gait that led here; `None` for the root.
    pub edge: Option<(usize, usize)>,
}

/// A tree of configurations. Node 0 is the root; a child comes after its parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// Nodes, in the order in which they were added.
    pub nodes: Vec<Node>,
}

impl Tree {
    /// Creates a tree of the root alone.
    pub fn new(root: Place) -> Self {
        Self { nodes: vec![Node { place: root, edge: None }] }
    }

    /// Returns the root's place.
    pub fn root(&self) -> &Place {
        &self.nodes[0].place
    }

    /// Returns the node indexes from the root to `node`, both included.
    pub fn path(&self, node: usize) -> Vec<usize> {
        let mut path = vec![node];
        while let Some((parent, _)) = self.nodes[path[path.len() - 1]].edge {
            path.push(parent);
        }
        path.reverse();
        path
    }

    /// Returns the index of the node with the least value; ties go to the lowest index.
    pub fn least(&self, value: impl Fn(&Place) -> f64) -> usize {
        let mut best = (0, f64::INFINITY);
        for (i, node) in self.nodes.iter().enumerate() {
            let v = value(&node.place);
            if v < best.1 {
                best = (i, v);
            }
        }
        best.0
    }
}
