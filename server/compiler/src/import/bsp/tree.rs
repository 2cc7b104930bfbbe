//! The lumps of a BSP file that hold the map's own subdivision and PVS.

use glam::DVec3;
use sightline_world::{OriginNode, OriginSide};

use super::{
    error::BspError,
    lumps::{Fields, Lumps, index},
};

/// The most nodes: at least four times what the game takes.
const NODES_MAX: usize = 1 << 20;
/// The most leafs.
const LEAFS_MAX: usize = 1 << 20;
/// The most clusters.
const CLUSTERS_MAX: usize = 1 << 18;

/// The map's own BSP tree and PVS.
pub(super) struct Tree<'a> {
    pub nodes: Vec<OriginNode>,
    pub leafs: Vec<Leaf>,
    pub clusters: u32,
    /// A row of bits for each cluster. Empty when the map has no vis lump.
    rows: &'a [u8],
    row_bytes: usize,
}

/// A leaf, in Quake units and axes.
pub(super) struct Leaf {
    pub min: DVec3,
    pub max: DVec3,
    pub cluster: Option<u32>,
}

impl<'a> Tree<'a> {
    pub(super) fn parse(lumps: &Lumps<'a>, planes: usize) -> Result<Self, BspError> {
        let leafs: Vec<Leaf> =
            lumps.records::<48>(4, "leafs", LEAFS_MAX)?.iter().map(leaf).collect();
        let nodes = lumps.records::<36>(3, "nodes", NODES_MAX)?;
        let fault = || BspError::Index { what: "node" };
        let nodes: Vec<OriginNode> = nodes
            .iter()
            .map(|bytes| node(bytes, planes, nodes.len(), leafs.len()))
            .collect::<Option<_>>()
            .ok_or_else(fault)?;
        let used = leafs.iter().filter_map(|leaf| leaf.cluster).max().map_or(0, |last| last + 1);
        let (clusters, row_bytes, rows) = match lumps.bytes(16)? {
            [] => (used, 0, &[][..]),
            lump => vis(lump).ok_or(BspError::Lump { lump: 16 })?,
        };
        if clusters as usize > CLUSTERS_MAX {
            return Err(BspError::TooMany("clusters"));
        }
        if used > clusters {
            return Err(BspError::Index { what: "leaf" });
        }
        Ok(Self { nodes, leafs, clusters, rows, row_bytes })
    }

    /// The rows without padding.
    pub(super) fn visible(&self) -> Vec<u8> {
        let kept = (self.clusters as usize).div_ceil(8);
        let rows = self.rows.chunks_exact(self.row_bytes.max(1));
        rows.flat_map(|row| &row[..kept.min(row.len())]).copied().collect()
    }
}

/// The number of clusters, the bytes of a row, and the rows of a vis lump.
fn vis(lump: &[u8]) -> Option<(u32, usize, &[u8])> {
    let mut fields = Fields(lump);
    let clusters = usize::try_from(fields.int()).ok()?;
    let row_bytes = usize::try_from(fields.int()).ok()?;
    let rows = lump.get(8..)?.get(..clusters.checked_mul(row_bytes)?)?;
    let is_whole = clusters > 0 && row_bytes >= clusters.div_ceil(8);
    is_whole.then_some((clusters as u32, row_bytes, rows))
}

fn node(bytes: &[u8; 36], planes: usize, nodes: usize, leafs: usize) -> Option<OriginNode> {
    let mut fields = Fields(bytes);
    let plane = index(fields.int(), planes)? as u32;
    let mut side = || match fields.int() {
        node @ 0.. => index(node, nodes).map(|node| OriginSide::Node(node as u32)),
        leaf => index(!leaf, leafs).map(|leaf| OriginSide::Leaf(leaf as u32)),
    };
    Some(OriginNode { plane, sides: [side()?, side()?] })
}

fn leaf(bytes: &[u8; 48]) -> Leaf {
    let mut fields = Fields(bytes);
    let cluster = fields.int();
    fields.skip(4);
    let mut corner = || DVec3::from_array(std::array::from_fn(|_| f64::from(fields.int())));
    let (min, max) = (corner(), corner());
    Leaf { min, max, cluster: u32::try_from(cluster).ok() }
}
