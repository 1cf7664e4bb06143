/**
 * What each field means, in a sentence, and where the documents say more. Fields are named by their pointers, those of
 * an aggregate as those of the mix, and controls without a pointer by their ids or names.
 */

/** @type {Record<string, [string, string]>} */
export const HELP = {
  table: ["A sieve analysis or a recipe, pasted whole: the service finds sieves, units and curves in it.", "mixes"],
  "/mix/grading/type": [
    "Which diameters the grains have, in which proportion by mass: a curve of a standard, a formula, or your sieves.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/standard": ["The standard whose limits are used.", "mixes#standards"],
  "/mix/grading/name": ["The grading of the standard, as the standard names it.", "mixes#standards"],
  "/mix/grading/curve": [
    "Which curve between the limits of the standard: the finer limit, the coarser one, or their mean.",
    "mixes#standards",
  ],
  "/mix/grading/median_mm": [
    "Half of the grains, by mass or by number, are finer than this diameter in mm.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/sigma": [
    "Standard deviation of the natural logarithm of the diameter; 0.4 is a wide law.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/mean_mm": ["Mean diameter in mm.", "mixes#curves-and-laws"],
  "/mix/grading/standard_deviation_mm": ["Standard deviation of the diameter in mm.", "mixes#curves-and-laws"],
  "/mix/grading/scale_mm": ["The diameter in mm that 63.2 % of the grains pass.", "mixes#curves-and-laws"],
  "/mix/grading/shape": [
    "Exponent of Weibull's law: the larger it is, the more equal the grains are.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/characteristic_mm": ["The diameter in mm that 63.2 % of the mass passes.", "mixes#curves-and-laws"],
  "/mix/grading/d_min_mm": [
    "The smallest diameter of the law in mm; finer grains do not occur in it.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/d_max_mm": [
    "The largest diameter of the curve in mm; all of the mass passes it.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/exponent": [
    "Exponent of the curve: 0.5 is Fuller's; smaller exponents have more fines.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/a_percent": [
    "The constant A of the curve in %: larger for plastic concrete and crushed grains.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/b_percent": [
    "The constant B of the curve in %: from 1 for fluid to 2 for dry concrete.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/k_percent": [
    "The correction K of the curve in %, for cement content, compaction and shape of the grains.",
    "mixes#curves-and-laws",
  ],
  "/mix/grading/by": ["What the law counts: a sieve weighs grains, a picture counts them.", "glossary#mix"],
  "/mix/grading/diameter_mm": ["The diameter of all grains in mm.", "mixes#curves-and-laws"],
  "/mix/grading/points": [
    "Sieves in mm with the mass that passes each, in %; between two sieves the curve is straight over log d.",
    "mixes#gradings",
  ],
  "/mix/d_min_mm": [
    "Grains finer than this diameter in mm belong to the matrix and are not placed; half of it means about eight times as many grains.",
    "choices#smallest-grain",
  ],
  "/mix/d_max_mm": [
    "Grains coarser than this diameter in mm count as aggregate and are not placed.",
    "mixes#curves-and-laws",
  ],
  content: [
    "How the amount of aggregate is stated: by its volume, by the number of grains, or by the contents of a cubic metre.",
    "mixes#recipes",
  ],
  "/mix/volume_fraction": [
    "Volume of the aggregate over the volume of the specimen, from 0 to 1; concrete has 0.6 to 0.75.",
    "glossary#mix",
  ],
  "/mix/volume_fraction_of": [
    "Whether the fraction counts all aggregate, or only the grains above the cut-off, which are placed.",
    "glossary#mix",
  ],
  "/mix/count": ["How many grains are placed; the volume follows from the grading.", "mixes#curves-and-laws"],
  "/mix/proportions/cement_kg_m3": ["Cement in kg in a cubic metre of concrete.", "mixes#recipes"],
  "/mix/proportions/water_cement": ["Mass of the water over the mass of the cement.", "mixes#recipes"],
  "/mix/proportions/aggregate_cement": [
    "Mass of the aggregate over the mass of the cement; empty: aggregate fills the rest of the volume.",
    "mixes#recipes",
  ],
  "/mix/proportions/air": ["Volume of the air over the volume of the concrete, from 0 to 1.", "mixes#recipes"],
  "/mix/share": ["Share of this aggregate in the volume of all aggregates; the shares sum to 1.", "mixes#blends"],
  "/mix/mass_kg_m3": ["Mass of this aggregate in kg in a cubic metre of concrete.", "mixes#recipes"],
  "/mix/density_kg_m3": ["Density of the grains in kg/m³; 2650 is common.", "mixes#recipes"],
  "/mix/name": ["What the aggregate is called in results and exports.", "mixes#recipes"],
  "/mix/shape/type": ["What a grain is: a sphere, an ellipsoid, or an angular polyhedron.", "shapes#shapes"],
  "/mix/shape/template": ["How the angular bodies are made that all grains are copies of.", "shapes#polyhedra"],
  "/mix/shape/name": ["A flakiness or shape category of EN 12620, or a measured source.", "shapes#presets"],
  "/mix/shape/ratios/type": [
    "Whether all grains have the same ratios of their axes a ≥ b ≥ c, or each its own.",
    "shapes#shapes",
  ],
  "/mix/shape/ratios/elongation": [
    "Ratio b/a of the intermediate to the long axis, from 0.1 to 1; 1 is not elongated.",
    "shapes#shapes",
  ],
  "/mix/shape/ratios/flatness": [
    "Ratio c/b of the short to the intermediate axis, from 0.1 to 1; 1 is not flat.",
    "shapes#shapes",
  ],
  "/mix/shape/ratios/k": [
    "Least ratio c/a of the short to the long axis, from 0.1 to 1; the ratios are uniform above it.",
    "shapes#shapes",
  ],
  "/mix/shape/faces": [
    "Planes that cut a grain out of a ball, 6 to 60: fewer make it more angular.",
    "shapes#polyhedra",
  ],
  "/mix/shape/displacement": [
    "How far the corners of a cube are moved, as a share of its edge, from 0 to 0.4.",
    "shapes#polyhedra",
  ],
  "/mix/shape/rounding": [
    "Radius of edges and corners over the diameter of the grain, from 0 (sharp) to 0.4.",
    "shapes#polyhedra",
  ],
  specimen: ["What is filled: a box, or a cylinder along z.", "choices#size-of-the-specimen"],
  "/specimen/size_mm/0": [
    "Length along x in mm; three to five times the largest grain, or more.",
    "choices#size-of-the-specimen",
  ],
  "/specimen/size_mm/1": [
    "Length along y in mm; three to five times the largest grain, or more.",
    "choices#size-of-the-specimen",
  ],
  "/specimen/size_mm/2": [
    "Height along z in mm; three to five times the largest grain, or more.",
    "choices#size-of-the-specimen",
  ],
  "/specimen/diameter_mm": ["Diameter of the cylinder in mm.", "choices#size-of-the-specimen"],
  "/specimen/height_mm": ["Height of the cylinder along z in mm.", "choices#size-of-the-specimen"],
  "/specimen/boundary": [
    "Walls keep grains inside as a mould does; with periodic faces a grain that leaves at one comes in at the other.",
    "method#2-specimen-and-walls",
  ],
  "/distance/type": ["The gap that any two grains keep, surface to surface; meshes need one.", "choices#gap"],
  "/distance/gap_mm": ["The gap between any two grains in mm, surface to surface.", "choices#gap"],
  "/distance/factor": ["The gap over the diameter that the rule names.", "method#3-distance-rules"],
  "/distance/wall_gap_mm": [
    "The gap between grains and walls in mm; empty: as the rule says.",
    "method#3-distance-rules",
  ],
  "/method/type": ["How positions are found; automatic takes the faster method that is likely to succeed.", "method"],
  "/method/stop/time_s": [
    "The run ends after this time in s, whether it has succeeded or not.",
    "failed#the-time-was-over",
  ],
  "/seed": [
    "The number from which all random numbers follow: the same seed and request give the same packing.",
    "glossary#packing",
  ],
  "/name": ["A name for lists and files; the packing does not depend on it.", "page#jobs"],
  "/materials/youngs_modulus_gpa": ["Young's modulus in GPa; 0 is a pore.", "properties"],
  "/materials/poissons_ratio": ["Poisson's ratio, from 0 to below 0.5.", "properties"],
  "/materials/density_kg_m3": ["Density in kg/m³.", "properties"],
  "/materials/conductivity_w_m_k": [
    "Thermal conductivity in W/(m K); other conductivities work in any unit.",
    "properties",
  ],
  "/materials/expansion_1_k": ["Coefficient of thermal expansion in 1/K, as 1e-5.", "properties"],
  runs: ["One packing, or a study: many packings for values of a field, with several seeds each.", "studies"],
  "vary-0": ["The field whose values the study varies.", "studies#the-request"],
  "vary-1": ["A second field, varied with the first.", "studies#the-request"],
  "values-0": ["Values as a list, 0.5, 0.6, 0.7, or as a range, 0.5 to 0.7 step 0.05.", "studies#the-request"],
  "values-1": ["Values as a list, 0.5, 0.6, 0.7, or as a range, 0.5 to 0.7 step 0.05.", "studies#the-request"],
  seeds: ["How many packings each combination of values has, each with a seed of its own.", "studies#seeds"],
};
