//! The phases of a packing with their materials, and which properties these allow.

use std::f64::consts::PI;

use super::options::{PropertyKind, PropertyKinds, PropertyOptions};
use super::report::PropertyPhase;
use crate::export::groups::AggregateGroups;
use crate::export::materials::{PhaseMaterial, of_model, phases};
use crate::export::{ExportError, Model};
use crate::homogenization::ElasticPhase;
use crate::request::decode::pointer_segment;
use crate::request::materials::{AGGREGATE, MATRIX};
use crate::request::{FieldError, Material, Materials};

/// The phases: the matrix, then the aggregates.
pub(super) struct Phases {
    pub(super) names: Vec<String>,
    materials: Vec<Material>,
    /// The kinds that are computed.
    pub(super) kinds: PropertyKinds,
    /// Stiffnesses, where a kind needs them.
    pub(super) elastic: Vec<ElasticPhase>,
    pub(super) conductivity: Option<Vec<f64>>,
    pub(super) diffusivity: Option<Vec<f64>>,
}

/// Stiffest over softest phase; none with pores. Without materials it is that of stone in mortar.
pub(super) fn contrast(materials: Option<&Materials>) -> Option<f64> {
    let moduli = || {
        let of_all = materials.into_iter().flat_map(Materials::entries);
        of_all.filter_map(|(_, material)| material.youngs_modulus_gpa)
    };
    let least = moduli().fold(f64::INFINITY, f64::min);
    let most = moduli().fold(0.0, f64::max);
    if least <= 0.0 {
        None
    } else if least < most {
        Some(most / least)
    } else {
        Some(3.0)
    }
}

/// A property that a kind needs of each phase.
type Needed = (&'static str, fn(&Material) -> Option<f64>);

const MODULUS: Needed = ("youngs_modulus_gpa", |material| material.youngs_modulus_gpa);
const RATIO: Needed =
    ("poissons_ratio", |material| material.poissons_ratio.or(material.is_pore().then_some(0.0)));
const EXPANSION: Needed =
    ("expansion_1_k", |material| material.expansion_1_k.or(material.is_pore().then_some(0.0)));
const CONDUCTIVITY: Needed = ("conductivity_w_m_k", |material| material.conductivity_w_m_k);
const DIFFUSIVITY: Needed = ("diffusivity_m2_s", |material| material.diffusivity_m2_s);

/// The elastic phase of a material; what it does not have is 0.
pub(in crate::export) fn of_material(material: &Material) -> ElasticPhase {
    let value = |(_, of): Needed| of(material).unwrap_or_default();
    ElasticPhase::new(value(MODULUS), value(RATIO), value(EXPANSION))
}

/// What a kind needs.
fn needed(kind: PropertyKind, materials: &[(String, Material)]) -> Vec<Needed> {
    match kind {
        PropertyKind::Stiffness => vec![MODULUS, RATIO],
        PropertyKind::Expansion => vec![MODULUS, RATIO, EXPANSION],
        // Either of the two, if all have it.
        PropertyKind::Conductivity if has_all(&[DIFFUSIVITY], materials) => vec![DIFFUSIVITY],
        PropertyKind::Conductivity => vec![CONDUCTIVITY],
    }
}

fn has_all(needed: &[Needed], materials: &[(String, Material)]) -> bool {
    materials.iter().all(|(_, material)| needed.iter().all(|(_, of)| of(material).is_some()))
}

/// The kinds that are computed with these materials, each by the pointer of its entry.
fn kinds_of(
    options: &PropertyOptions,
    materials: &[(String, Material)],
) -> Result<PropertyKinds, ExportError> {
    let possible = || {
        let all = PropertyKind::ALL.into_iter();
        all.filter(|kind| has_all(&needed(*kind, materials), materials)).collect::<Vec<_>>()
    };
    let kinds = match &options.kinds {
        Some(kinds) => kinds.clone(),
        None => match possible() {
            none if none.is_empty() => PropertyKinds::of(vec![PropertyKind::Stiffness]),
            some => PropertyKinds::of(some),
        },
    };
    let mut faults = Vec::new();
    for kind in kinds.iter() {
        for (name, of) in needed(kind, materials) {
            for (phase, _) in materials.iter().filter(|(_, material)| of(material).is_none()) {
                let pointer = format!("/materials/{}/{name}", pointer_segment(phase));
                if faults.iter().all(|fault: &FieldError| fault.pointer != pointer) {
                    faults.push(FieldError::new(
                        pointer,
                        format!("is missing: kinds={} needs it of each phase", kind.name()),
                    ));
                }
            }
        }
    }
    // Whatever carries loads or heat between the grains is the matrix.
    if let Some((phase, material)) = materials.first().filter(|(phase, _)| phase == MATRIX) {
        let mut positive: Vec<Needed> = Vec::new();
        if kinds.is_elastic() {
            positive.push(MODULUS);
        }
        if kinds.has(PropertyKind::Conductivity) {
            positive.extend([CONDUCTIVITY, DIFFUSIVITY]);
        }
        for (name, of) in positive {
            if of(material) == Some(0.0) {
                faults.push(FieldError::new(
                    format!("/materials/{phase}/{name}"),
                    "0 is out of range: must be more than 0, as pores are in the matrix and not around it",
                ));
            }
        }
    }
    if faults.is_empty() { Ok(kinds) } else { Err(ExportError::Invalid(faults)) }
}

/// Checks the materials of the phases: the matrix first.
///
/// # Errors
/// [`ExportError::Invalid`] with every property that is missing, and a matrix that is a pore.
pub(in crate::export) fn check_materials(
    phases: &[PhaseMaterial<'_>],
    options: &PropertyOptions,
) -> Result<(), ExportError> {
    kinds_of(options, &named(phases)).map(drop)
}

fn named(phases: &[PhaseMaterial<'_>]) -> Vec<(String, Material)> {
    phases.iter().map(|phase| (phase.name.to_owned(), *phase.material)).collect()
}

impl Phases {
    /// The phases of a packing.
    ///
    /// # Errors
    /// [`ExportError::Invalid`] without materials, and for one that is missing or incomplete.
    pub(super) fn of(model: &Model<'_>, options: &PropertyOptions) -> Result<Self, ExportError> {
        let materials = of_model(options.materials.as_ref(), model)?;
        let groups = AggregateGroups::of(model);
        let given = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
        let mut names = vec![MATRIX.to_owned()];
        let mut of_aggregates = Vec::new();
        if groups.is_empty() {
            names.push(AGGREGATE.to_owned());
            of_aggregates.push(given.first().cloned().flatten());
        }
        for (number, (group, _)) in groups.all().enumerate() {
            names.push(group.to_owned());
            of_aggregates.push(given.get(number).cloned().flatten());
        }
        let present = named(&phases(materials, &of_aggregates)?);
        let kinds = kinds_of(options, &present)?;
        let materials: Vec<Material> = present.iter().map(|(_, material)| *material).collect();
        let values = |(_, of): Needed| -> Option<Vec<f64>> {
            kinds.has(PropertyKind::Conductivity).then(|| materials.iter().map(of).collect()).flatten()
        };
        Ok(Self {
            conductivity: values(CONDUCTIVITY),
            diffusivity: values(DIFFUSIVITY),
            elastic: materials.iter().map(of_material).collect(),
            names,
            materials,
            kinds,
        })
    }

    /// Their materials.
    pub(super) fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// The phases with their shares of the voxels and by the grains.
    pub(super) fn reported(&self, model: &Model<'_>, shares: &[f64]) -> Vec<PropertyPhase> {
        let groups = AggregateGroups::of(model);
        let mut exact = vec![0.0; self.names.len()];
        for grain in 0..model.grains.len() {
            let d = model.grains.d_mm(grain);
            exact[1 + groups.of_grain(grain)] += PI / 6.0 * d * d * d;
        }
        let volume_mm3 = model.specimen.volume_mm3();
        for share in &mut exact {
            *share /= volume_mm3;
        }
        exact[0] = 1.0 - exact[1..].iter().sum::<f64>();
        let each = self.names.iter().zip(shares).zip(exact).zip(&self.materials);
        each.map(|(((name, share), exact_share), material)| PropertyPhase {
            name: name.clone(),
            share: *share,
            exact_share,
            material: *material,
        })
        .collect()
    }
}
