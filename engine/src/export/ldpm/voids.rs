//! Air voids of a packing: grains of an aggregate whose material has no stiffness. The nodes of a lattice are the
//! centres of stiff grains (Cusatis, Pelessone and Mencarelli 2011), so that voids are left out.

use crate::export::Model;
use crate::packing::Grains;
use crate::request::Material;

/// The grains without the air voids; `None` where there are no voids.
pub(super) fn without_voids(model: &Model<'_>) -> Option<Grains> {
    let (materials, provenance) = (model.materials?, model.provenance?);
    let is_void = |aggregate: u16| {
        let name = provenance.aggregates.get(usize::from(aggregate)).and_then(Option::as_deref);
        materials.of_aggregate(name).is_some_and(Material::is_pore)
    };
    let aggregate = model.grains.aggregate();
    if !aggregate.iter().any(|&of| is_void(of)) {
        return None;
    }
    let kept: Vec<usize> = (0..aggregate.len()).filter(|&grain| !is_void(aggregate[grain])).collect();
    Some(model.grains.of_rows(&kept))
}
