//! Names of the groups that tell several aggregates of a mix apart, the same in all files that have groups.

use super::Model;
use super::solid::{PhaseRole, PhaseSet};

/// The aggregates of a packing as groups of its grains: none where the mix names no aggregates.
#[derive(Debug)]
pub(super) struct AggregateGroups<'a> {
    /// The aggregate of each grain, counted from 0.
    of: &'a [u16],
    /// Names of the groups in the order of the aggregates, those without a grain too.
    names: Vec<String>,
    /// Grains of each.
    grains: Vec<u64>,
}

impl<'a> AggregateGroups<'a> {
    /// Those of a packing.
    pub(super) fn of(model: &Model<'a>) -> Self {
        let of = model.grains.aggregate();
        let given = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
        let count = of.iter().max().map_or(0, |most| usize::from(*most) + 1).max(given.len());
        let mut grains = vec![0; count];
        for aggregate in of {
            grains[usize::from(*aggregate)] += 1;
        }
        let name = |number: usize| group_name(number, given.get(number).and_then(Option::as_deref));
        Self { of, names: if of.is_empty() { Vec::new() } else { (0..count).map(name).collect() }, grains }
    }

    /// Whether there are none, so that all grains are one group.
    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Gives the phases that are groups the names of the request.
    pub(super) fn name_phases(&self, model: &Model<'_>, phases: &mut [PhaseSet]) {
        let given = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
        for (number, group) in self.with_grains() {
            if let Some(phase) = phases.iter_mut().find(|phase| phase.name == group) {
                phase.role = PhaseRole::Aggregate { name: given.get(number).cloned().flatten() };
            }
        }
    }

    /// The aggregate of a grain, counted from 0; 0 where there are none.
    pub(super) fn of_grain(&self, grain: usize) -> usize {
        self.of.get(grain).copied().unwrap_or(0).into()
    }

    /// All groups in the order of the aggregates, with the number of grains in each.
    pub(super) fn all(&self) -> impl Iterator<Item = (&str, u64)> {
        self.names.iter().map(String::as_str).zip(self.grains.iter().copied())
    }

    /// The groups that have grains, each with the number of its aggregate, counted from 0.
    pub(super) fn with_grains(&self) -> impl Iterator<Item = (usize, &str)> {
        self.all()
            .enumerate()
            .filter(|(_, (_, grains))| *grains > 0)
            .map(|(number, (name, _))| (number, name))
    }
}

/// `aggregate_1`, and its name after that with everything but ASCII letters, digits, `-` and `.` replaced by `_`: no
/// reader of groups refuses it (Abaqus has 80 characters and no spaces), and the number keeps groups apart whose names
/// become equal.
fn group_name(number: usize, name: Option<&str>) -> String {
    let mut group = format!("aggregate_{}", number + 1);
    if let Some(name) = name {
        group.push('_');
        group.extend(
            name.chars().map(|c| if c.is_ascii_alphanumeric() || "-.".contains(c) { c } else { '_' }),
        );
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_groups_have_the_number_and_plain_characters() {
        assert_eq!(group_name(0, None), "aggregate_1");
        assert_eq!(group_name(15, Some("Kies 2/8, rund")), "aggregate_16_Kies_2_8__rund");
        assert_eq!(group_name(1, Some("gr\u{e8}s \"x\"")), "aggregate_2_gr_s__x_");
        assert!(group_name(15, Some(&"a".repeat(64))).len() <= 80);
    }
}
