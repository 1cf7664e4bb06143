% Computes the effective stiffness of a periodic cube, with bounds.
%
%   octave-cli packstone_stiffness.m   or, in MATLAB, packstone_stiffness
%
% examples/notebooks/stiffness.ipynb does the same in Python, with the same bits.

%% Pack
request = struct();
request.specimen = struct('type', 'box', 'size_mm', [30 30 30], 'boundary', 'periodic');
request.mix.grading = struct('type', 'standard', 'name', 'A8');
request.mix.volume_fraction = 0.6;
request.mix.d_min_mm = 2;
request.materials.matrix = struct('youngs_modulus_gpa', 25, 'poissons_ratio', 0.2);
request.materials.aggregate = struct('youngs_modulus_gpa', 70, 'poissons_ratio', 0.2);
request.seed = 1;
job = packstone_api('POST', '/v1/jobs', request);
job = packstone_wait(['/v1/jobs/' job.id]);

%% Compute
% 32 voxels along an edge are few: the error below says what they cost.
packstone_api('GET', ['/v1/jobs/' job.id '/exports/properties?cells=32'], [], 'properties.json');
report = jsondecode(fileread('properties.json'));
stiffness = report.stiffness;
modulus = stiffness.isotropic.youngs_modulus_gpa;

%% Check
bounds = stiffness.bounds;
assert(bounds.hashin_shtrikman_lower.youngs_modulus_gpa < modulus);
assert(modulus < bounds.hashin_shtrikman_upper.youngs_modulus_gpa);
disp(stiffness.stiffness_gpa);
fprintf('relative error: %.1e by voxels, %.1e by the solver\n', stiffness.error.voxels, stiffness.error.solver);
fprintf('result: Young''s modulus %.17g GPa\n', modulus);
