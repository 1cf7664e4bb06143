function document = packstone_wait(path)
%PACKSTONE_WAIT  Waits for the end of a job, a study or an export, and returns its document.
%
%   job = packstone_wait('/v1/jobs/ID')
%
% The server holds each answer back until the work has ended, or for a minute. A job or an export that has failed is an
% error with the explanation of the server.

document = packstone_api('GET', path);
while isempty(document.finished_at)
    document = packstone_api('GET', path);
end
if isfield(document, 'error') && ~isempty(document.error)
    error('packstone:failed', '%s: %s', path, document.error.detail);
end
end
