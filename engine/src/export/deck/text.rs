//! The texts of a deck: the model with its step, the materials, the plates, and the README.
//!
//! Keywords are those that Abaqus and CalculiX have in common, after the manual of Abaqus 2024 and that of CalculiX
//! 2.20 (Dhondt, *CalculiX CrunchiX user's manual*). CalculiX reads the first 20 characters of a number and knows no
//! sets of nodes in `*EQUATION`.

use std::fmt::Write as _;

use super::frame::Frame;
use super::load::{ALL_FACES, Conditions, Load, Prescribed};
use super::options::Solver;
use super::report::{DeckReport, LateralFaces};
use super::sets::NodeSets;
use crate::export::Provenance;
use crate::export::solid::PlaneState;

/// Name of the deck: the job that a solver is told to run.
pub(super) const MODEL: &str = "model";
/// Characters of a number that CalculiX reads.
const MOST_CHARACTERS: usize = 20;
/// What the numbers of a deck mean.
pub(super) const UNITS: &str = "Units: mm, N, MPa, tonne, s, K (density tonne/mm3, conductivity mW/(mm K)).";

/// A number as decks have it: to the last bit where that takes 20 characters, else with 12 digits.
pub(super) fn number(x: f64) -> String {
    let exact = format!("{x:?}");
    if exact.len() <= MOST_CHARACTERS { exact } else { format!("{x:.11e}") }
}

/// What a deck is about, as the lines that begin each of its files.
pub(super) fn head(report: &DeckReport, provenance: Option<&Provenance>) -> Vec<String> {
    let mut lines = vec![
        format!("Packstone {}: deck for {}, load {}", crate::VERSION, report.solver.title(), amount(report)),
        UNITS.to_owned(),
    ];
    if let Some(made) = &report.tetrahedra {
        lines.push(format!(
            "Mesh: {} tetrahedra by {}, smallest gamma {:.3}",
            made.elements, made.mesher, made.smallest_gamma
        ));
    }
    if let (Some(plane), Some(made)) = (&report.plane, &report.triangles) {
        lines.push(format!(
            "Mesh: {} triangles of the cut across {} at {} mm by {}, smallest gamma {:.3}",
            made.elements,
            plane.axis.name(),
            plane.at_mm,
            made.mesher,
            made.smallest_gamma
        ));
    }
    if let Some(from) = provenance {
        let mut line = String::from("Packing:");
        if let Some(seed) = from.seed {
            let _ = write!(line, " seed {seed},");
        }
        let _ = write!(line, " volume fraction of the grains {:.5}", from.volume_fraction_effective);
        if let Some(digest) = &from.result_sha256 {
            let _ = write!(line, ", result {digest}");
        }
        lines.push(line);
    }
    lines
}

fn amount(report: &DeckReport) -> String {
    let name = report.load.name();
    match (report.strain, report.temperature_change_k) {
        (Some(strain), _) => format!("{name}, strain {strain:?}"),
        (None, Some(change)) => format!("{name}, {change:?} K"),
        (None, None) => name.to_owned(),
    }
}

/// Lines as comments of a deck.
pub(super) fn comments(lines: &[String]) -> String {
    lines.iter().fold(String::new(), |mut text, line| {
        let _ = writeln!(text, "** {line}");
        text
    })
}

/// The materials and the sections.
pub(super) fn materials(head: &[String], report: &DeckReport) -> String {
    let mut text = comments(head);
    for phase in &report.phases {
        let name = &phase.name;
        let _ = writeln!(text, "*MATERIAL, NAME={name}\n*ELASTIC");
        let _ =
            writeln!(text, "{}, {}", number(phase.youngs_modulus_gpa * 1e3), number(phase.poissons_ratio));
        if let Some(expansion) = phase.expansion_1_k {
            let _ = writeln!(text, "*EXPANSION, ZERO=0.\n{}", number(expansion));
        }
        if let Some(conductivity) = phase.conductivity_w_m_k {
            let _ = writeln!(text, "*CONDUCTIVITY\n{}", number(conductivity));
        }
        if let Some(density) = phase.density_kg_m3 {
            let _ = writeln!(text, "*DENSITY\n{}", number(density * 1e-12));
        }
        let _ = writeln!(text, "** Plasticity and damage of {name} go here, before its section.");
        let _ = writeln!(text, "*SOLID SECTION, ELSET={name}, MATERIAL={name}");
        if let Some(plane) = &report.plane {
            let _ = writeln!(text, "{}", number(plane.thickness_mm));
        }
    }
    text
}

/// The model: includes, sets, supports, and the step with its load and its output.
pub(super) fn model(
    head: &[String],
    report: &DeckReport,
    conditions: &Conditions,
    sets: &NodeSets<'_>,
) -> String {
    let mut text = comments(head);
    // The title of CalculiX ends after 80 characters.
    let title: String = head.first().map(String::as_str).unwrap_or_default().chars().take(79).collect();
    let _ = writeln!(text, "*HEADING\n{title}");
    text.push_str("*INCLUDE, INPUT=mesh.inp\n*INCLUDE, INPUT=materials.inp\n");
    let _ = writeln!(text, "*NSET, NSET=all_nodes, GENERATE\n1, {}, 1", report.nodes);
    let faces = sets.face_names();
    let _ = writeln!(text, "*NSET, NSET={ALL_FACES}\n{}", faces.join(", "));
    for (pin, node) in sets.pins() {
        let _ = writeln!(text, "*NSET, NSET={pin}\n{}", u64::from(node) + 1);
    }
    if !conditions.tied.is_empty() {
        let tied: Vec<&str> = conditions.tied.iter().map(|(face, _)| *face).collect();
        let _ = writeln!(text, "** Free plates, which stay plane: {}.", tied.join(", "));
        text.push_str("*INCLUDE, INPUT=plates.inp\n");
    }
    if report.temperature_change_k.is_some() {
        text.push_str("*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall_nodes, 0.\n");
    }
    text.push_str("** Supports.\n*BOUNDARY\n");
    let prescribed = conditions.prescribed.iter();
    let (supports, loads): (Vec<&Prescribed>, Vec<&Prescribed>) =
        prescribed.partition(|prescribed| prescribed.value_mm == 0.0);
    for support in supports {
        let axis = support.axis + 1;
        let _ = writeln!(text, "{}, {axis}, {axis}", support.set);
    }
    text.push_str("** The load.\n*STEP\n");
    text.push_str(match report.solver {
        // The iterative solvers of CalculiX leave reactions out of balance by 0.1 %.
        Solver::Calculix => "*STATIC, SOLVER=SPOOLES\n",
        Solver::Abaqus => "*STATIC\n1., 1.\n",
    });
    if !loads.is_empty() {
        text.push_str("*BOUNDARY\n");
    }
    for load in loads {
        let axis = load.axis + 1;
        let _ = writeln!(text, "{}, {axis}, {axis}, {}", load.set, number(load.value_mm));
    }
    if let Some(change) = report.temperature_change_k {
        let _ = writeln!(text, "*TEMPERATURE\nall_nodes, {}", number(change));
    }
    text.push_str("** Output.\n");
    text.push_str(match report.solver {
        // CalculiX computes plane elements as solid ones, whose nodes have other numbers.
        Solver::Calculix if report.plane.is_some() => {
            "*NODE FILE, OUTPUT=2D\nU\n*EL FILE, OUTPUT=2D\nS, E\n"
        }
        Solver::Calculix => "*NODE FILE\nU\n*EL FILE\nS, E\n",
        Solver::Abaqus => {
            "*OUTPUT, FIELD\n*NODE OUTPUT\nU, RF\n*ELEMENT OUTPUT\nS, E\n*OUTPUT, HISTORY, VARIABLE=PRESELECT\n"
        }
    });
    let _ = writeln!(text, "*NODE PRINT, NSET={ALL_FACES}, TOTALS=YES");
    text.push_str(match report.solver {
        Solver::Calculix => "U, RF\n",
        Solver::Abaqus => "U\n*NODE PRINT, NSET=faces, TOTALS=YES\nRF\n",
    });
    text.push_str("*END STEP\n");
    text
}

/// Appends an equation that gives a node the displacement of another along an axis.
pub(super) fn push_equation(text: &mut Vec<u8>, node: u32, first: u32, axis: usize) {
    let (node, first, axis) = (u64::from(node) + 1, u64::from(first) + 1, axis + 1);
    text.extend_from_slice(format!("*EQUATION\n2\n{node},{axis},1.,{first},{axis},-1.\n").as_bytes());
}

/// The README.
pub(super) fn readme(head: &[String], report: &DeckReport, frame: &Frame) -> String {
    let mut text = String::new();
    for line in head {
        let _ = writeln!(text, "{line}");
    }
    let [x, y, z] = report.size_mm.map(|x| format!("{x}"));
    let _ = writeln!(
        text,
        "\nSpecimen {x} x {y} x {z} mm, {} mm3; {} elements {}, {} nodes, {} degrees of freedom.",
        report.volume_mm3,
        report.number_of_elements,
        report.element_type,
        report.nodes,
        report.degrees_of_freedom
    );
    if let Some(plane) = &report.plane {
        let _ = writeln!(
            text,
            "A plane model: the cut across {} at {} mm, in plane {}. x and y of the mesh are {} and {} of the specimen; faces\n\
             and loads have the names of the specimen's axes.",
            plane.axis.name(),
            plane.at_mm,
            plane.state.name(),
            frame.name(0),
            frame.name(1)
        );
    }
    for phase in &report.phases {
        let _ = writeln!(
            text,
            "  {}: {} elements, {:.6} of the volume, E {} GPa, Poisson's ratio {}{}",
            phase.name,
            phase.elements,
            phase.volume_mm3 / report.volume_mm3,
            phase.youngs_modulus_gpa,
            phase.poissons_ratio,
            phase.expansion_1_k.map_or_else(String::new, |alpha| format!(", expansion {alpha:e} 1/K"))
        );
    }
    for warning in &report.warnings {
        let _ = writeln!(text, "Note: {warning}");
    }
    text.push_str("\nRun it in this folder:\n");
    text.push_str(match report.solver {
        Solver::Calculix => {
            "  packstone solve .     runs CalculiX and computes the properties below, or\n  ccx model             runs CalculiX alone\n"
        }
        Solver::Abaqus => {
            "  abaqus job=model\nThe keywords follow the manual of Abaqus. No test of Packstone runs Abaqus.\n"
        }
    });
    text.push_str("\nBoundary conditions\n");
    text.push_str(&conditions_in_words(report, frame));
    text.push_str("\nProperties\n");
    text.push_str(&properties_in_words(report, frame));
    text.push_str(
        "\nFiles\n  model.inp      supports, load, step and output; includes the others\n  \
         mesh.inp       nodes, elements, a set of elements for each phase, a set of nodes and a surface for each face\n  \
         materials.inp  linear materials; comments mark the place for plasticity and damage\n  \
         plates.inp     equations that keep free plates plane, where the load has such plates\n  \
         deck.json      these figures, for packstone solve\n",
    );
    text
}

fn conditions_in_words(report: &DeckReport, frame: &Frame) -> String {
    let is_free = report.lateral_faces == LateralFaces::Free;
    if let Some([a, b]) = sheared(report, frame) {
        let mut text = format!(
            "The faces across {a} are displaced along {b}, those across {b} along {a}, by half of the shear angle each.\n",
            a = frame.name(a),
            b = frame.name(b)
        );
        if let Some(c) = (0..frame.dimension()).find(|c| ![a, b].contains(c)) {
            let _ = writeln!(text, "No face moves along {}.", frame.name(c));
        }
        text.push_str(
            "All other displacements are free. (A cell that is mirrored at its faces and sheared as a whole has these\n\
             displacements.)\n",
        );
        return text;
    }
    let mut text = String::new();
    let held: Vec<&str> =
        (if is_free { 2..3 } else { 0..frame.dimension() }).map(|axis| frame.faces(axis)[0]).collect();
    let _ = writeln!(
        text,
        "Smooth rigid plates hold the faces: every node of a face has the same displacement normal to it and none\n\
         along it. {} do not move.",
        held.join(", ")
    );
    if let Some(axis) = stretched(report, frame) {
        let _ =
            writeln!(text, "{} is moved by the strain times the edge of the specimen.", frame.faces(axis)[1]);
    }
    if is_free {
        text.push_str(
            "The lateral surface is free of stress. Two nodes of the bottom keep the specimen from sliding and turning\n\
             (pin_axis, pin_rotation); no force acts on them.\n",
        );
        if report.load == Load::Temperature {
            text.push_str("z_max stays plane and is free to move: the force on it is zero.\n");
        }
    } else {
        text.push_str(
            "The other plates stay plane and are free to move: the force on each is zero. (A cell that is mirrored at its\n\
             faces and stretched with no mean stress across has these displacements.)\n",
        );
    }
    text
}

/// The axis of the mesh that a load stretches.
fn stretched(report: &DeckReport, frame: &Frame) -> Option<usize> {
    frame.place(report.load.axis()?)
}

/// The axes of the mesh whose plane a load shears.
fn sheared(report: &DeckReport, frame: &Frame) -> Option<[usize; 2]> {
    let [a, b] = report.load.plane()?;
    Some([frame.place(a)?, frame.place(b)?])
}

fn properties_in_words(report: &DeckReport, frame: &Frame) -> String {
    let volume = report.volume_mm3;
    if let Some([a, b]) = sheared(report, frame) {
        return format!(
            "Mean stress: sum of RF{} times {} over the set faces, divided by {volume} mm3.\n\
             Shear modulus: the mean stress divided by the shear angle.\n",
            a + 1,
            ["x", "y", "z"][b]
        );
    }
    if let Some(axis) = stretched(report, frame) {
        let area = volume / frame.size_mm[axis];
        let mut text = format!(
            "Young's modulus: sum of RF{} over the set {}, divided by {area} mm2 and by the strain.\n\
             Poisson's ratio: minus the lateral strain divided by the strain; the lateral strain is the displacement of\n\
             a lateral plate divided by the edge, of a cylinder the radial displacement divided by the radius.\n",
            axis + 1,
            frame.faces(axis)[1]
        );
        if report.plane.is_some_and(|plane| plane.state == PlaneState::Strain) {
            text.push_str(
                "Both are those of plane strain: E / (1 - nu^2) and nu / (1 - nu) of an isotropic solid.\n",
            );
        }
        return text;
    }
    let mut text = String::from(
        "Coefficient of expansion along an axis: displacement of the plate divided by the edge and by the change of the\n\
         temperature.\n",
    );
    if report.plane.is_some_and(|plane| plane.state == PlaneState::Strain) {
        text.push_str("It is that of plane strain: (1 + nu) times that of an isotropic solid.\n");
    }
    text
}
