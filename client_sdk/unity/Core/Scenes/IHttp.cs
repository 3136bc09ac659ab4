using System;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport
{
    /// <summary>One request over HTTP: what an engine replaces where .NET's own client does not work (WebGL).</summary>
    public interface IHttp
    {
        /// <summary>GET a file. Redirects are not followed: the token goes to that server alone.</summary>
        /// <param name="url">http(s) address.</param>
        /// <param name="token">Sent as <c>Authorization: Bearer</c>; none is sent where it is null or empty.</param>
        /// <param name="maxBytes">Bound of the body, of whatever status.</param>
        /// <param name="onBytes">Told of bytes that came, on whatever thread; may be null.</param>
        /// <param name="cancelled">Ends the request.</param>
        /// <returns>The answer, whatever its status.</returns>
        /// <exception cref="TerraportException">"unreachable" without an answer; "damaged" where more bytes come.</exception>
        /// <exception cref="OperationCanceledException">It was cancelled.</exception>
        Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, Action<int> onBytes, CancellationToken cancelled);
    }
}
