using System;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport
{
    /// <summary>The answer to an HTTP request.</summary>
    public struct HttpAnswer
    {
        /// <summary>Status of any answer, also of a refusal.</summary>
        public int Status;

        /// <summary>The body.</summary>
        public ArraySegment<byte> Body;
    }

    /// <summary>Fetches files over HTTP. Redirects are not followed: the token stays with one server.</summary>
    public interface IHttp
    {
        /// <summary>Fetch a file.</summary>
        /// <param name="url">Its address.</param>
        /// <param name="token">Bearer token; null for none.</param>
        /// <param name="maxBytes">Bytes of the body at most.</param>
        /// <param name="cancelled">Ends it.</param>
        /// <exception cref="TerraportException">"unreachable" without an answer, "damaged" where it is longer.</exception>
        Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, CancellationToken cancelled);
    }
}
