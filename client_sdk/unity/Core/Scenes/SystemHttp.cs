using System;
using System.IO;
using System.Net.Http;
using System.Net.Http.Headers;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport
{
    /// <summary>HTTP by .NET's own client, on threads of the pool.</summary>
    public sealed class SystemHttp : IHttp
    {
        /// <summary>How long nothing may come, milliseconds.</summary>
        private const int StallMs = 30000;
        private const int ChunkBytes = 1 << 16;

        // One for the process: each client has connections of its own.
        private static readonly HttpClient Client = new HttpClient(new HttpClientHandler { AllowAutoRedirect = false });

        /// <inheritdoc/>
        public async Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, Action<int> onBytes, CancellationToken cancelled)
        {
            // Inside, continuations need no particular thread; the caller's come back on the caller's context.
            // Linked: it fires for the caller's cancellation and for a stall; which one it was is asked of `cancelled` below.
            using (CancellationTokenSource stalled = CancellationTokenSource.CreateLinkedTokenSource(cancelled)) using (
                var request = new HttpRequestMessage(HttpMethod.Get, url))
            {
                try
                {
                    // 1. Send, and wait for the headers alone.
                    if (!string.IsNullOrEmpty(token))
                    {
                        request.Headers.Authorization = new AuthenticationHeaderValue("Bearer", token);
                    }
                    stalled.CancelAfter(StallMs);
                    const HttpCompletionOption headersFirst = HttpCompletionOption.ResponseHeadersRead;
                    Task<HttpResponseMessage> responding = Client.SendAsync(request, headersFirst, stalled.Token);
                    using (HttpResponseMessage response = await responding.ConfigureAwait(false)) using (
                        Stream stream = await response.Content.ReadAsStreamAsync().ConfigureAwait(false))
                    {
                        // 2. A body of the declared length, and one byte to see that it ends; never more than the bound, whatever is declared.
                        long declaredBytes = response.Content.Headers.ContentLength ?? 0;
                        var body = new byte[(int)Math.Max(1, Math.Min(declaredBytes > 0 ? declaredBytes + 1 : ChunkBytes, maxBytes + 1L))];
                        int length = 0;
                        for (;;)
                        {
                            // 3. Read. Each chunk starts the stall clock anew: a slow link is not a stalled one.
                            stalled.CancelAfter(StallMs);
                            int capacity = Math.Min(ChunkBytes, body.Length - length);
                            int receivedBytes = await stream.ReadAsync(body, length, capacity, stalled.Token).ConfigureAwait(false);
                            if (receivedBytes == 0)
                            {
                                return new HttpAnswer((int)response.StatusCode, body, length);
                            }
                            length += receivedBytes;
                            if (length > maxBytes)
                            {
                                throw new TerraportException("damaged", url + " has more than " + maxBytes + " bytes, the most expected");
                            }
                            if (onBytes != null)
                            {
                                onBytes(receivedBytes);
                            }
                            // More than was declared, or nothing was: twice as long, up to a byte beyond the bound.
                            if (length == body.Length)
                            {
                                Array.Resize(ref body, (int)Math.Min(2L * length, maxBytes + 1L));
                            }
                        }
                    }
                }
                catch (OperationCanceledException error)
                {
                    // 4. Cancelled by the caller: tell so, whatever broke first. Everything else is an unreachable server.
                    cancelled.ThrowIfCancellationRequested();
                    throw Unreachable(url, "nothing for " + StallMs / 1000 + " s", error);
                }
                catch (Exception error)
                {
                    cancelled.ThrowIfCancellationRequested();
                    if (error is HttpRequestException || error is IOException || error is ObjectDisposedException)
                    {
                        throw Unreachable(url, (error.InnerException ?? error).Message, error);
                    }
                    throw;
                }
            }
        }

        private static TerraportException Unreachable(string url, string reason, Exception error)
        {
            string text = "no answer from " + url + " (" + reason + "); is the server running, and reachable from here?";
            return new TerraportException("unreachable", text, null, error);
        }
    }
}
