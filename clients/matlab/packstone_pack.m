% Packs a cube, and reads the grains into arrays. With `packstone serve` on this machine:
%
%   octave-cli packstone_pack.m        or, in MATLAB, packstone_pack
%
% examples/notebooks/pack.ipynb does the same in Python, with the same bits.

%% Pack
request = struct();
request.specimen = struct('type', 'box', 'size_mm', [40 40 40]);
request.mix.grading = struct('type', 'standard', 'name', 'A8');
request.mix.volume_fraction = 0.7;
request.mix.d_min_mm = 2;
request.distance = struct('type', 'constant', 'gap_mm', 0.2);
request.seed = 1;
job = packstone_api('POST', '/v1/jobs', request);
job = packstone_wait(['/v1/jobs/' job.id]);
summary = job.result.summary;

%% Read the grains
% One row a grain, the largest first: the centre and the diameter in mm.
packstone_api('GET', ['/v1/jobs/' job.id '/result?format=csv'], [], 'packing.csv');
grains = dlmread('packing.csv', ',', 1, 0);
positions = grains(:, 1:3);
diameters = grains(:, 4);

%% Check
% The smallest distance of two surfaces is at least the gap.
gap = inf;
for k = 2:numel(diameters)
    centres = sqrt(sum((positions(1:k - 1, :) - positions(k, :)).^2, 2));
    gap = min(gap, min(centres - (diameters(1:k - 1) + diameters(k)) / 2));
end
assert(gap > 0.2 - 1e-9);
assert(abs(pi / 6 * sum(diameters.^3) / 40^3 - summary.volume_fraction_effective) < 1e-12);
fprintf('the largest grain has %.3f mm, the smallest gap %.4f mm\n', diameters(1), gap);
fprintf('result: %d grains, volume fraction %.17g\n', numel(diameters), summary.volume_fraction_effective);
