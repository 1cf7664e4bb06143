#![allow(clippy::unwrap_used)]

use super::super::answer::{Level, Recipe};
use super::super::number::decimals;
use super::super::split::readings;
use super::*;

/// The recipes of a text in its first reading that has one.
fn of(text: &str) -> Recipes {
    for tables in readings(text) {
        let cells =
            tables.iter().flat_map(|table| &table.rows).flat_map(|row| row.cells.iter().map(String::as_str));
        let decimal = decimals(cells)[0];
        match read(&tables, decimal) {
            Recipes::None => {}
            found => return found,
        }
    }
    Recipes::None
}

fn all(text: &str) -> Vec<Recipe> {
    match of(text) {
        Recipes::Read(recipes) => recipes,
        other => panic!("{text}: {other:?}"),
    }
}

fn one(text: &str) -> Recipe {
    let mut recipes = all(text);
    assert_eq!(recipes.len(), 1, "{text}: {recipes:?}");
    recipes.remove(0)
}

fn refused(text: &str) -> String {
    match of(text) {
        Recipes::Refused(refusal) => {
            let note = refusal.note();
            format!("{}: {}", note.line.unwrap_or(0), note.text)
        }
        other => panic!("{text}: {other:?}"),
    }
}

fn warnings(recipe: &Recipe) -> Vec<&str> {
    recipe.notes.iter().filter(|note| note.level == Level::Warning).map(|note| note.text.as_str()).collect()
}

fn near(value: impl Into<Option<f64>>, expected: f64) {
    let value = value.into().unwrap_or(f64::NAN);
    assert!((value - expected).abs() <= 5e-4 * expected.abs().max(1e-3), "{value} is not {expected}");
}

/// Cement, water, and the name, mass and density of each aggregate.
fn contains(recipe: &Recipe, cement: f64, water: f64, aggregates: &[(&str, f64, Option<f64>)]) {
    near(recipe.cement_kg_m3, cement);
    near(recipe.water_kg_m3, water);
    near(recipe.water_cement, water / cement);
    let names: Vec<&str> = recipe.aggregates.iter().map(|aggregate| aggregate.name.as_str()).collect();
    assert_eq!(names, aggregates.iter().map(|of| of.0).collect::<Vec<_>>());
    for (aggregate, (_, mass, density)) in recipe.aggregates.iter().zip(aggregates) {
        near(aggregate.mass_kg_m3, *mass);
        match density {
            Some(density) => near(aggregate.density_kg_m3, *density),
            None => assert_eq!(aggregate.density_kg_m3, None),
        }
    }
}

#[test]
fn recipes_with_densities_fill_a_cubic_metre() {
    let recipe = one("Stoff;Gehalt [kg/m³];Dichte [kg/dm³]\nZement CEM II/C-M(S-LL) 42,5 \
         N;300;3,0\nFlugasche;60;2,4\nWasser;170;1,0\n\
         Gesteinskörnung;1794;2,6\nLuftporen;1,5 Vol.-%;\n");
    contains(&recipe, 300.0, 170.0, &[("Gesteinskörnung", 1794.0, Some(2600.0))]);
    near(recipe.air_volume_fraction, 0.015);
    near(recipe.aggregate_volume_fraction, 0.69);
    // 300/3.0 + 60/2.4 + 170 + 1794/2.6 litres.
    near(recipe.volume_sum_m3, 0.985);
    near(recipe.implied_air, 0.015);
    near(recipe.additions[0].mass_kg_m3, 60.0);
    assert_eq!(warnings(&recipe), [""; 0]);
}

#[test]
fn lines_of_a_text_are_recipes() {
    let recipe = one(
        "M40 ( 1 : 1.67 : 2.39)\nCement : 430 Kg/ M 3\n20 mm Jelly : 618 Kg/ M 3\n12.5 mm Jelly : 412 Kg/ M 3\n\
         River sand : 718 Kg/ M 3\nWater Cement ratio : 0.43\nAdmixture : 0.7%\n",
    );
    assert_eq!(recipe.name.as_deref(), Some("M40"));
    contains(
        &recipe,
        430.0,
        184.9,
        &[("20 mm Jelly", 618.0, None), ("12.5 mm Jelly", 412.0, None), ("River sand", 718.0, None)],
    );
    // 430/3.1 + 184.9 + 1748/2.65 litres, with the densities that are assumed.
    near(recipe.volume_sum_m3, 0.983_232);
    assert_eq!(warnings(&recipe), [""; 0]);
    let recipe = one(
        "Cemento……………………292 kg/m3\nAgua de diseño……………..180 kg/m3\nAgregado fino seco………....770 kg/m3\n\
         Agregado grueso seco………1135 kg/m3\nAbsorción……………………….. 0.8% 0.6%\nContenido de humedad………….. 5.1% 3.2%\n",
    );
    contains(&recipe, 292.0, 180.0, &[("Agregado fino", 770.0, None), ("Agregado grueso", 1135.0, None)]);
    assert_eq!((recipe.name.as_deref(), warnings(&recipe)), (None, vec![]));
}

#[test]
fn pounds_a_cubic_yard_and_specific_gravities_are_read() {
    let recipe = one(
        "Material,\"Weight (lb/yd³)\",\"Specific gravity\"\n\"Portland cement, Type I/II\",564,3.15\nWater,282,1.00\n\
         \"Coarse aggregate No. 57 (SSD)\",1825,2.68\n\"Fine aggregate (SSD)\",1238,2.63\n\"Air, %\",2.0,\n\
         \"Water reducer (oz/cwt)\",4.0,\n",
    );
    contains(
        &recipe,
        334.608,
        167.304,
        &[("Coarse aggregate No. 57", 1082.729, Some(2680.0)), ("Fine aggregate", 734.476, Some(2630.0))],
    );
    near(recipe.air_volume_fraction, 0.02);
    near(recipe.aggregate_volume_fraction, 0.683_27);
    assert_eq!(warnings(&recipe), [""; 0]);
    let recipe = one(
        "Material,Wt/cum,Specific Gravity\nWater,180,\nCement,600,3.13\nFine aggregate,359.965,2.63\nCoarse \
         aggregate,1329.45,2.82\n",
    );
    contains(
        &recipe,
        600.0,
        180.0,
        &[("Fine aggregate", 359.965, Some(2630.0)), ("Coarse aggregate", 1329.45, Some(2820.0))],
    );
    near(recipe.aggregate_volume_fraction, 0.6083);
}

#[test]
fn recipes_stand_side_by_side() {
    let recipes = all("Bezeichnung;C25/30 F3;C30/37 F4\nZement CEM III/A 42,5 N [kg/m³];300;340\nWasser \
         [kg/m³];174;170\nw/z;0,58;0,50\n\
         Sand 0/2 (2,64 kg/dm³) [kg/m³];705;670\nKies 2/8 (2,62 kg/dm³) [kg/m³];470;455\n\
         Kies 8/16 (2,61 kg/dm³) [kg/m³];665;690\nLuft [Vol.-%];1,8;1,8\nFließmittel [kg/m³];1,5;2,7\n");
    assert_eq!(recipes.len(), 2);
    assert_eq!(recipes[0].name.as_deref(), Some("C25/30 F3"));
    let sand = |kg| ("Sand 0/2", kg, Some(2640.0));
    contains(
        &recipes[0],
        300.0,
        174.0,
        &[sand(705.0), ("Kies 2/8", 470.0, Some(2620.0)), ("Kies 8/16", 665.0, Some(2610.0))],
    );
    near(recipes[0].aggregate_volume_fraction, 0.701_22);
    contains(
        &recipes[1],
        340.0,
        170.0,
        &[sand(670.0), ("Kies 2/8", 455.0, Some(2620.0)), ("Kies 8/16", 690.0, Some(2610.0))],
    );
    near(recipes[1].air_volume_fraction, 0.018);
    // Blast furnace cement: 300/3.0 + 174 + 701.22 litres.
    near(recipes[0].volume_sum_m3, 0.975_22);
    assert!(recipes.iter().all(|recipe| warnings(recipe).is_empty()), "{recipes:?}");
}

#[test]
fn a_cubic_yard_is_named() {
    let recipe = one("mix,cement kg,sand kg,gravel kg,water kg\nC20,251,690,742,148\n");
    assert_eq!(recipe.name.as_deref(), Some("C20"));
    contains(&recipe, 251.0, 148.0, &[("sand", 690.0, None), ("gravel", 742.0, None)]);
    // 251/3.1 + (690 + 742)/2.65 + 148 litres.
    near(recipe.volume_sum_m3, 0.769_345);
    near(recipe.implied_air, 0.230_655);
    let warnings = warnings(&recipe).join("\n");
    assert!(warnings.contains("cubic yard") && warnings.contains("cement 328.3"), "{warnings}");
    assert!(warnings.contains("23.065 % of air"), "{warnings}");
}

#[test]
fn a_grading_is_no_recipe() {
    for text in [
        "Sieve mm,Passing %\n0.125,5\n4,40\n16,100\n",
        "Sieb;Sand 0/2;Kies 2/8;Kies 8/16\n0,25;14;0,6;0,1\n2;96;6;0,3\n8;100;95;7\n16;100;100;94\n",
        "Gravel 3 8 100\nSand 60 90 100\n",
        "Sieve,Mass retained (g)\n4,120\n2,210\nPan,35\nTotal,365\n",
        "Fine aggregate\nSieve (mm) Passing (%)\n4 98\n2 75\n0.5 30\n",
    ] {
        assert_eq!(of(text), Recipes::None, "{text}");
    }
}

#[test]
fn water_is_effective_by_its_kind() {
    // 190 less 1.2 % of 720 and 0.8 % of 1080.
    let total =
        one("Constituent,Dry mass (kg/m³),Density OD (kg/m³),Absorption (%)\nCEM II/A-LL 42.5 R,340,3050,\n\
         Sand 0/4,720,2600,1.2\nGravel 4/16,1080,2650,0.8\nTotal water,190,,\nAir,2.0 %,,\n");
    near(total.water_kg_m3, 190.0 - 8.64 - 8.64);
    near(total.cement_density_kg_m3, 3050.0);
    // Wet sand has 6 % of water and takes up 1 %: 848 kg are 800 kg dry, with 40 kg of water on them.
    let added = one(
        "Material;kg/m³;Absorption %;Feuchte %\nZement;320;;\nZugabewasser;130;;\nSand 0/4;848;1,0;6,0\nKies \
         4/16;1010;0,5;1,0\n",
    );
    near(added.water_kg_m3, 130.0 + 40.0 + 1010.0 * 0.005 / 1.01);
    let effective = one(
        "Ciment (kg/m3);385\nSable 0/4 (kg/m3);790\nGravillon 6/14 (kg/m3);1005\nEau ajoutée (kg/m3);188,5\nEau \
         efficace (kg/m3);173\n",
    );
    near(effective.water_kg_m3, 173.0);
    assert_eq!(effective.aggregates[1].name, "Gravillon 6/14");
}

#[test]
fn the_ratio_of_water_counts_additions_by_their_factor() {
    let text = |ratio: &str| {
        format!("Zement;300 kg/m³\nFlugasche;60 kg/m³\n{ratio}\nSand 0/2;700 kg/m³\nKies 2/16;1120 kg/m³\n")
    };
    for (ratio, water) in [
        ("w/z;0,55", 165.0),
        ("w/(z + 0,4 f);0,5", 0.5 * 324.0),
        ("(w/z)eq;0,5", 0.5 * 324.0),
        ("w/b;0,45", 0.45 * 360.0),
        ("k-Wert;0,7\nw/b;0,5", 0.5 * 342.0),
        ("w/z;55 %", 165.0),
    ] {
        let recipe = one(&text(ratio));
        near(recipe.water_kg_m3, water);
        near(recipe.water_cement, water / 300.0);
        assert_eq!(recipe.additions[0].mass_kg_m3, 60.0, "an addition is no cement: {ratio}");
    }
    // From the water and the ratio.
    let recipe = one("Water;170 kg/m³\nw/c;0.5\nSand 0/2;750 kg/m³\nGravel;1110 kg/m³\n");
    near(recipe.cement_kg_m3, 340.0);
    // Water over cement is 0.56 and over cement with fly ash 0.467.
    let both = one(&text("Wasser;168 kg/m³\nw/z;0,467"));
    near(both.water_cement, 0.56);
    assert_eq!(warnings(&both), [""; 0]);
}

#[test]
fn aggregates_in_percent_are_parts_of_their_total() {
    let recipe = one(
        "Betonrezeptur;C30/37 XC4 XF1\nZement CEM I 42,5 R;320 kg/m³\nWasser;176 kg/m³\nw/z-Wert;0,55\n\
         Gesteinskörnung gesamt;1850 kg/m³\n davon 0/2;38 %\n davon 2/8;27 %\n davon 8/16;35 %\nKornrohdichte;2,65 kg/dm³\nLuftgehalt;1,5 %\n",
    );
    let density = Some(2650.0);
    contains(
        &recipe,
        320.0,
        176.0,
        &[("0/2", 703.0, density), ("2/8", 499.5, density), ("8/16", 647.5, density)],
    );
    assert_eq!(recipe.name.as_deref(), Some("C30/37 XC4 XF1"));
    // As fractions, and of what the other parts leave: 1 - 0.31/3.1 - 0.155 - 0.02 = 0.725 m3.
    let recipe = one(
        "Cement: 310 kg/m³\nWater: 155 kg/m³\nAir: 2 %\nSand 0/4 (2.6 kg/dm³): 40 %\nGravel 4/16 (2.7 kg/dm³): 60 %\n",
    );
    let all = 0.725 / (0.4 / 2600.0 + 0.6 / 2700.0);
    near(recipe.aggregates[0].mass_kg_m3, 0.4 * all);
    near(recipe.aggregate_volume_fraction, 0.725);
    near(recipe.implied_air, 0.02);
    let fractions = one(
        "Zement;320 kg/m³\nWasser;176 kg/m³\nGesteinskörnung gesamt;1850 kg/m³\n0/2;0,38\n2/8;0,27\n8/16;0,35\n",
    );
    near(fractions.aggregates[2].mass_kg_m3, 647.5);
}

#[test]
fn batches_become_a_cubic_metre() {
    let recipe = one(
        "Mischung 40 l;\nZement;13,6 kg\nWasser;7,1 kg\nSand 0/2;29,6 kg\nKies 2/16;43,2 kg\nFließmittel;68 g\n",
    );
    contains(&recipe, 340.0, 177.5, &[("Sand 0/2", 740.0, None), ("Kies 2/16", 1080.0, None)]);
    // 450/3.1 + 225 + 1350/2.65 ml.
    let factor = 1000.0 / (450.0 / 3.1 + 225.0 + 1350.0 / 2.65);
    for text in [
        "Zement;450 ± 2 g\nWasser;225 ± 1 g\nCEN-Normsand EN 196-1;1350 ± 5 g\n",
        "cement : sand : water (by mass)\n1 : 3 : 0.5\n",
        "Mortar 1:3, w/c = 0.5\n",
        "Water : cement : sand = 0.5 : 1 : 3\n",
    ] {
        let recipe = one(text);
        near(recipe.cement_kg_m3, 450.0 * factor);
        near(recipe.water_kg_m3, 225.0 * factor);
        near(recipe.aggregates[0].mass_kg_m3, 1350.0 * factor);
        near(recipe.volume_sum_m3, 1.0);
        assert!(warnings(&recipe)[0].contains("states no volume"), "{recipe:?}");
    }
    // With densities and air nothing is assumed.
    let recipe = one("Material,kg,Density kg/dm³\nCement,10,3.1\nWater,5,1.0\nSand,30,2.6\nAir,4 %,\n");
    near(recipe.cement_kg_m3, 0.96 / (1.0 / 3100.0 + 0.5 / 1000.0 + 3.0 / 2600.0));
    assert_eq!(warnings(&recipe), [""; 0]);
    near(recipe.implied_air, 0.04);
}

#[test]
fn ratios_take_the_cement_from_the_text() {
    let recipe = one("Concrete 1 : 2 : 3 by mass\nCement: 350 kg/m³\nw/c: 0.5\n");
    contains(&recipe, 350.0, 175.0, &[("sand", 700.0, None), ("gravel", 1050.0, None)]);
    let recipe = one(
        "Mischungsverhältnis in Massenteilen\nZement : Sand 0/4 : Kies 4/16 : Wasser\n1 : 2,1 : 3,2 : 0,5\n",
    );
    // 1/3.1 + 2.1/2.65 + 3.2/2.65 + 0.5 litres for a kilogram of cement.
    near(recipe.cement_kg_m3, 1000.0 / (1.0 / 3.1 + 5.3 / 2.65 + 0.5));
    assert_eq!(recipe.aggregates[1].name, "Kies 4/16");
}

#[test]
fn what_is_open_is_asked() {
    let asked = |text: &str| match of(text) {
        Recipes::Ask(choices) => choices,
        other => panic!("{text}: {other:?}"),
    };
    let choices =
        asked("Material;Cantidad por m³\nCemento;7 bultos\nAgua;175 l\nArena;780 kg\nGrava;1050 kg\n");
    let cements: Vec<f64> = choices.iter().map(|(_, recipe)| recipe.cement_kg_m3.unwrap()).collect();
    for (cement, bag) in cements.iter().zip([25.0, 35.0, 42.5, 50.0, 42.637_682_78]) {
        near(*cement, 7.0 * bag);
    }
    assert!(choices[3].0.contains("50 kg"), "{}", choices[3].0);
    let known = one(
        "Cimento CP II-E-32 (saco de 50 kg);7 sacos/m³\nÁgua;175 l/m³\nAreia média;780 kg/m³\nBrita 1;1050 kg/m³\n",
    );
    near(known.cement_kg_m3, 350.0);
    let choices =
        asked("Concrete for footings;parts by volume\ncement;1\nsand;2\ngravel 5/20;4\nwater;0.6\n");
    assert_eq!(choices.len(), 2);
    let loose = &choices[0].1;
    assert_eq!(asked("Concrete: 1 cement : 2 sand : 4 gravel by volume, w/c = 0.55\n").len(), 2);
    // 1200 kg of cement, 600 of water, 2900 of sand, 5600 of gravel.
    near(loose.water_cement, 0.5);
    near(loose.aggregates[0].mass_kg_m3 / loose.cement_kg_m3.unwrap(), 2900.0 / 1200.0);
    near(loose.aggregates[1].mass_kg_m3 / loose.cement_kg_m3.unwrap(), 5600.0 / 1200.0);
}

#[test]
fn amounts_in_american_units_are_read() {
    let recipe = one(
        "MIX 6A   per cu yd\nCement        611 lb\nWater         33 gal\nSand (SSD)    1,250 lb\nStone #67 (SSD)  \
         1,700 lb\nAEA           5 oz\nAir           6.0 %\n",
    );
    let pound = 0.453_592_37 / 0.764_554_857_984;
    contains(
        &recipe,
        611.0 * pound,
        33.0 * 3.785_411_784 / 0.764_554_857_984,
        &[("Sand", 1250.0 * pound, None), ("Stone #67", 1700.0 * pound, None)],
    );
    assert_eq!(recipe.name.as_deref(), Some("MIX 6A"));
    let sacks = one(
        "Cement = 7.05 sacks (Type IA)\nWater = 38.6 gallons\nCA = 17.0 cf or 1,768 lb/cy\nFA = 10.5 cf or 1,083 \
         lb/cy\nAir content = 5 percent\n",
    );
    near(sacks.cement_kg_m3, 7.05 * 94.0 * pound);
    near(sacks.aggregates[0].mass_kg_m3, 1768.0 * pound);
    assert!(warnings(&sacks)[0].contains("94 lb"), "{sacks:?}");
}

#[test]
fn absolute_volumes_give_masses_and_densities() {
    let recipe = one(
        "Stoffraum;dm³/m³;Dichte kg/dm³\nZement;103,2;3,10\nWasser;176,0;1,00\nSand 0/4;310,0;2,62\nKies \
         4/16;390,0;2,65\nLuft;18,0;\n",
    );
    contains(
        &recipe,
        319.92,
        176.0,
        &[("Sand 0/4", 812.2, Some(2620.0)), ("Kies 4/16", 1033.5, Some(2650.0))],
    );
    near(recipe.air_volume_fraction, 0.018);
    let recipe = one(
        "Components,Water,Cement,Sand (FA),Coarse Aggregate\nBy Mass in Kg,197.00,410.00,632.00,1230.00\nBy Volume \
         in M3,0.197,0. 1301,0.2395,0.4333\n",
    );
    near(recipe.aggregates[0].density_kg_m3, 632.0 / 0.2395);
    near(recipe.cement_density_kg_m3, 410.0 / 0.1301);
}

#[test]
fn subtotals_and_totals_do_not_count_twice() {
    let recipe = one(
        "Cement Content = 400 kg/m3\nw/c Ratio = 0.45\nsp. Gravity of cement = 3.15\nsp. Gravity of 10mm aggregate \
         = 2.83\n\
         sp. Gravity of 20mm aggregate = 2.83\nsp. Gravity of sand = 2.62\nwater content = 180 lit/m3\nC.A. = 1246.33 kg\n\
         60 %  20mm = 747.79 kg/m3\n40 %  10mm = 498.53 kg/m3\nF.A. = 617.44 kg/m3\n",
    );
    contains(
        &recipe,
        400.0,
        180.0,
        &[("20mm", 747.79, Some(2830.0)), ("10mm", 498.53, Some(2830.0)), ("F.A.", 617.44, Some(2620.0))],
    );
    near(recipe.cement_density_kg_m3, 3150.0);
    let recipe =
        one("Cement;350 kg/m³\nWater;175 kg/m³\nSand;700 kg/m³\nGravel;1120 kg/m³\nTotal;2345 kg/m³\n");
    assert_eq!(recipe.aggregates.len(), 2);
}

#[test]
fn fibres_and_admixtures_are_no_aggregate() {
    let recipe = one(
        "Component\tkg/m³\tDensity g/cm³\nCEM I 52,5 R\t650\t3.10\nSilica fume\t65\t2.20\nQuartz sand \
         0.125/0.5\t1380\t2.65\n\
         Water\t180\t1.00\nPCE superplasticizer (solids 30 %)\t20\t1.07\nSteel fibres 13 x 0.16 mm (2 vol.-%)\t157\t7.85\n",
    );
    contains(&recipe, 650.0, 180.0, &[("Quartz sand 0.125/0.5", 1380.0, Some(2650.0))]);
    // 650/3.1 + 65/2.2 + 1380/2.65 + 180 + 20/1.07 + 157/7.85 litres.
    near(recipe.volume_sum_m3, 0.978_669);
}

#[test]
fn tables_read_from_the_right_to_the_left_are_the_same() {
    let recipe = one("kg/m³;Stoff\n300;Zement\n175;Wasser\n720;Sand 0/2\n1150;Kies 2/16\n");
    contains(&recipe, 300.0, 175.0, &[("Sand 0/2", 720.0, None), ("Kies 2/16", 1150.0, None)]);
    let recipes =
        all("water kg/m3,gravel kg/m3,sand kg/m3,cement kg/m3,mix\n175,1110,730,330,A\n180,1090,720,350,B\n");
    assert_eq!(recipes[1].name.as_deref(), Some("B"));
    near(recipes[1].cement_kg_m3, 350.0);
}

#[test]
fn wrong_recipes_are_refused_with_their_row() {
    for (text, line, words) in [
        ("Stoff;kg/m³\nWasser;175\nSand 0/4;800\nKies 4/16;1050\n", 2, "no cement"),
        ("Material,kg per m3\ncement,300\nsand,720\ngravel,1165\n", 2, "no water"),
        (
            "Component,kg/m³\nCement,300\nWater,180\nw/c,0.45\nSand,750\nGravel,1100\n",
            4,
            "0.45, and the masses give 0.6",
        ),
        ("Stoff;kg/m³\nZement;300\nWasser;170\nSand;-780\nKies;1100\n", 4, "at least 0"),
        (
            "Stoff;kg/m³;Dichte kg/dm³\nZement;340;3,10\nWasser;170;1,00\nSand;760;0\nKies;1060;2,65\n",
            4,
            "density",
        ),
        (
            "Zement;330 kg/m³\nWasser;170 kg/m³\nGesteinskörnung;1830 kg/m³\n0/2;35 %\n2/8;25 %\n8/16;33 %\n",
            4,
            "93 %",
        ),
        (
            "Cement;350 kg/m³\nWater;175 kg/m³\nSand;700 kg/m³\nGravel;1120 kg/m³\nTotal;2400 kg/m³\n",
            5,
            "at most 1 %",
        ),
        ("Stoff;kg/m³\nZement;viel\nWasser;175\nSand;800\nKies;1000\n", 2, "\"viel\""),
        ("Stoff;kg/m³\nZement;300 - 350\nWasser;175\nSand;800\nKies;1000\n", 2, "one number"),
        ("Cement;350\nWater;175\nSand;300\nGravel;600\n", 1, "no unit"),
        ("Zement;350 kg/m³\nWasser;175\nSand;800 kg/m³\nKies;1000 kg/m³\n", 2, "without a unit"),
        ("Cement;350 stones\nWater;175 kg/m³\nSand;800 kg/m³\nGravel;1000 kg/m³\n", 1, "\"350 stones\""),
    ] {
        let refusal = refused(text);
        assert!(refusal.starts_with(&format!("{line}: ")) && refusal.contains(words), "{text}: {refusal}");
    }
}

#[test]
fn contents_that_no_concrete_has_are_warned_of() {
    for (text, words) in [
        ("Cement;90 kg/m³\nWater;100 kg/m³\nSand;900 kg/m³\nGravel;1300 kg/m³\n", "cement_kg_m3 is 90"),
        ("Cement;250 kg/m³\nWater;310 kg/m³\nSand;700 kg/m³\nGravel;900 kg/m³\n", "water_cement is 1.24"),
        ("Cement;900 kg/m³\nWater;150 kg/m³\nSand;1500 kg/m³\n", "water_cement is 0.1667"),
        ("Cement;300 kg/m³\nWater;150 kg/m³\nSand;600 kg/m³\nGravel;900 kg/m³\n", "of air"),
        (
            "Cement;400 kg/m³\nWater;200 kg/m³\nSand;800 kg/m³\nGravel;1200 kg/m³\n",
            "must fill 0.97 to 1.005 m3",
        ),
        ("Cement;564\nWater;282\nSand;1238\nGravel;1825\n", "lb/yd3"),
        ("Cement;340\nWater;170\nSand;750\nGravel;1100\n", "no unit"),
    ] {
        let recipe = one(text);
        assert!(
            warnings(&recipe).iter().any(|warning| warning.contains(words)),
            "{text}: {:?}",
            warnings(&recipe)
        );
    }
    // 12 % of air beside parts that leave it: the sum with the air is a cubic metre.
    let airy = one(
        "Stoff;kg/m³\nCEM III/A 42,5 N;360\nWasser;170\nSand 0/2;680\nKies 2/8;900\nLuftporen;12 Vol.-%\n",
    );
    near(airy.air_volume_fraction, 0.12);
    assert!(warnings(&airy).iter().any(|warning| warning.contains("at most 10 %")));
}

#[test]
fn recipes_below_one_another_are_several() {
    let recipes =
        all("Mix A\nCement: 350 kg/m³\nWater: 175 kg/m³\nSand 0/4: 720 kg/m³\nGravel: 1100 kg/m³\n\n\
         Mix B\nCement: 300 kg/m³\nWater: 180 kg/m³\nSand 0/4: 760 kg/m³\nGravel: 1080 kg/m³\n");
    let names: Vec<_> = recipes.iter().map(|recipe| recipe.name.as_deref()).collect();
    assert_eq!(names, [Some("Mix A"), Some("Mix B")]);
    near(recipes[1].water_cement, 0.6);
}

#[test]
fn sentences_with_amounts_are_recipes() {
    let recipe = one("Zement 350 kg/m³, Wasser 175 kg/m³, Sand 0/2 700 kg/m³ und Kies 2/16 1100 kg/m³");
    contains(&recipe, 350.0, 175.0, &[("Sand 0/2", 700.0, None), ("Kies 2/16", 1100.0, None)]);
    let recipe = one(
        "Ciment CEM II/A-LL 42,5 R : 320 kg/m3\nEau : 165 l/m3\nSable 0/4 : 810 kg/m3\nGravillon 4/12 : 1020 \
         kg/m3\nAir : 1,5 %\n",
    );
    contains(&recipe, 320.0, 165.0, &[("Sable 0/4", 810.0, None), ("Gravillon 4/12", 1020.0, None)]);
}
