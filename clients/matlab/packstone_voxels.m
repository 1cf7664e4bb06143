% Makes voxels of a packing, and reads them as an array of three dimensions.
%
%   octave-cli packstone_voxels.m      or, in MATLAB, packstone_voxels
%
% examples/notebooks/voxels.ipynb does the same in Python.

%% Pack
request = struct();
request.specimen = struct('type', 'box', 'size_mm', [40 40 40]);
request.mix.grading = struct('type', 'standard', 'name', 'A8');
request.mix.volume_fraction = 0.5;
request.mix.d_min_mm = 4;
request.distance = struct('type', 'constant', 'gap_mm', 0.5);
request.seed = 1;
job = packstone_api('POST', '/v1/jobs', request);
job = packstone_wait(['/v1/jobs/' job.id]);

%% Make the voxels
% `raw` has the labels alone, one byte each, x fastest: the order of arrays in MATLAB. 0 is the matrix.
packstone_api('GET', ['/v1/jobs/' job.id '/exports/voxels?format=raw&cells=80'], [], 'voxels.raw');
in = fopen('voxels.raw');
labels = reshape(fread(in, 80^3, 'uint8=>uint8'), [80 80 80]);
fclose(in);

%% Check
share = nnz(labels) / numel(labels);
exact = job.result.summary.volume_fraction_effective;
assert(abs(share - exact) < 0.005);
% A section through the middle, in MATLAB with a display: imagesc(labels(:, :, 40)'); axis image xy
fprintf('the grains fill %.4f of the voxels and %.4f of the cube\n', share, exact);
fprintf('result: %d of %d voxels\n', nnz(labels), numel(labels));
