% A lab script: three volume fractions, two methods, five seeds; waits, reads the table, and reads one of the
% packings into arrays. MATLAB R2020b or later, no toolbox.
%
% The server and the key, where it asks for one, are those of the environment variables PACKSTONE_URL and
% PACKSTONE_API_KEY. When a request is refused MATLAB shows the status only; clients/curl/study.sh shows the
% server's explanation, which names the field and the bound.

url = getenv('PACKSTONE_URL');
if isempty(url)
    url = 'http://127.0.0.1:8080';
end
fields = {'Idempotency-Key', char(java.util.UUID.randomUUID())};
key = getenv('PACKSTONE_API_KEY');
if ~isempty(key)
    fields(end + 1, :) = {'Authorization', ['Bearer ' key]};
end

%% Submit
% Keys that are JSON pointers are no names of struct fields: the grid is a map. Lists of one value would have to
% be cell arrays, since jsonencode writes [0.5] as a number.
job.specimen = struct('type', 'box', 'size_mm', [60 60 60]);
job.mix.grading = struct('type', 'standard', 'name', 'A16');
job.mix.d_min_mm = 4;
job.mix.volume_fraction = 0.5;
job.distance = struct('type', 'constant', 'mm', 0.5);
job.method.type = 'auto';

grid = containers.Map();
grid('/mix/volume_fraction') = [0.45 0.55 0.65];
grid('/method/type') = {'rsa', 'edmd'};

request.name = 'A16 by two methods';
request.seed = 1;
request.template = job;
request.grid = grid;
request.replicates = 5;

post = weboptions('RequestMethod', 'post', 'MediaType', 'application/json', 'ContentType', 'json', ...
    'HeaderFields', fields, 'Timeout', 60);
study = webwrite([url '/v1/studies'], jsonencode(request), post);
fprintf('submitted as %s\n', study.links.self);
% `self` is a name like any other in MATLAB.
study_url = [url study.links.self];

%% Wait
% Each answer is held back until the study has ended, or for a minute.
fields(1, :) = {'Prefer', 'wait=60'};
wait = weboptions('ContentType', 'json', 'HeaderFields', fields, 'Timeout', 90);
while isempty(study.finished_at)
    study = webread(study_url, wait);
    fprintf('%d succeeded, %d failed, of %d\n', study.counts.succeeded, study.counts.failed, study.jobs);
end

%% The table
% One row per volume fraction and method. It is saved first, so that the names of the columns are kept as they are.
fields(1, :) = {'Accept', '*/*'};
get = weboptions('HeaderFields', fields, 'Timeout', 60);
websave('table.csv', [study_url '/table?format=csv'], get);
rows = readtable('table.csv', 'VariableNamingRule', 'preserve');
disp(rows(:, {'/mix/volume_fraction', '/method/type', 'runs', 'successes', 'success_rate', 'time_s_median'}));
websave('success.svg', [study_url '/plot.svg?kind=success'], get);

%% One packing, as arrays
list = weboptions('ContentType', 'json', 'HeaderFields', fields, 'Timeout', 60);
page = webread([study_url '/jobs?state=succeeded&limit=1'], list);
websave('packing.csv', [url page.items(1).links.self '/result?format=csv'], get);
spheres = readmatrix('packing.csv');
[x, y, z, d] = deal(spheres(:, 1), spheres(:, 2), spheres(:, 3), spheres(:, 4));
fprintf('%d grains; the largest, of %.3f mm, lies at (%.3f, %.3f, %.3f) mm\n', numel(d), d(1), x(1), y(1), z(1));
