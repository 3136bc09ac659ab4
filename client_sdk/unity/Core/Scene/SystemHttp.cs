using System;
using System.IO;
using System.Net.Http;
using System.Net.Http.Headers;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport
{
    /// <summary>HTTP by .NET's own client: every platform but WebGL.</summary>
    internal sealed class SystemHttp : IHttp
    {
        /// <summary>How long nothing may come.</summary>
        private static readonly TimeSpan Stall = TimeSpan.FromSeconds(30);

        // One for the process: each client has connections of its own.
        private static readonly HttpClient Client = new HttpClient(new HttpClientHandler { AllowAutoRedirect = false });

        public async Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, CancellationToken cancelled)
        {
            using (CancellationTokenSource stalled = CancellationTokenSource.CreateLinkedTokenSource(cancelled)) using (
                var request = new HttpRequestMessage(HttpMethod.Get, url))
            {
                try
                {
                    if (!string.IsNullOrEmpty(token)) request.Headers.Authorization = new AuthenticationHeaderValue("Bearer", token);
                    stalled.CancelAfter(Stall);
                    Task<HttpResponseMessage> responding =
                        Client.SendAsync(request, HttpCompletionOption.ResponseHeadersRead, stalled.Token);
                    using (HttpResponseMessage response = await responding.ConfigureAwait(false)) using (
                        Stream stream = await response.Content.ReadAsStreamAsync().ConfigureAwait(false))
                    {
                        var body = new MemoryStream();
                        var chunk = new byte[1 << 16];
                        for (;;)
                        {
                            // Each chunk starts the clock again: a slow link has not stalled.
                            stalled.CancelAfter(Stall);
                            int count = await stream.ReadAsync(chunk, 0, chunk.Length, stalled.Token).ConfigureAwait(false);
                            if (count == 0) break;
                            body.Write(chunk, 0, count);
                            if (body.Length > maxBytes)
                                throw new TerraportException("damaged", url + " has more than " + maxBytes + " bytes, the most expected");
                        }
                        var bytes = new ArraySegment<byte>(body.GetBuffer(), 0, (int)body.Length);
                        return new HttpAnswer { Status = (int)response.StatusCode, Body = bytes };
                    }
                }
                catch (Exception error) when (error is OperationCanceledException || error is HttpRequestException || error is IOException)
                {
                    cancelled.ThrowIfCancellationRequested();
                    string reason = error is OperationCanceledException ? "nothing for 30 s" : (error.InnerException ?? error).Message;
                    string text = "no answer from " + url + " (" + reason + "); is the server running, and reachable from here?";
                    throw new TerraportException("unreachable", text, null, error);
                }
            }
        }
    }
}
