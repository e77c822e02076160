// A surface in the light of a volume alone: colour times LpvbakeIrradianceOverPi. Shaders of one's own
// add direct light to it.
Shader "Lpvbake/Lit by volume"
{
    Properties
    {
        _MainTex("Colour", 2D) = "white" {}
        _Color("Tint", Color) = (1, 1, 1, 1)
    }
    SubShader
    {
        Tags { "RenderType" = "Opaque" }
        Pass
        {
            HLSLPROGRAM
            #pragma target 4.0
            #pragma vertex vertex
            #pragma fragment fragment
            #include "UnityCG.cginc"
            #include "Lpvbake.hlsl"

            sampler2D _MainTex;
            float4 _MainTex_ST;
            float4 _Color;

            struct Varyings
            {
                float4 clip : SV_POSITION;
                float3 position : TEXCOORD0;
                float3 normal : TEXCOORD1;
                float2 uv : TEXCOORD2;
            };

            Varyings vertex(appdata_base v)
            {
                Varyings o;
                o.clip = UnityObjectToClipPos(v.vertex);
                o.position = mul(unity_ObjectToWorld, v.vertex).xyz;
                o.normal = UnityObjectToWorldNormal(v.normal);
                o.uv = TRANSFORM_TEX(v.texcoord, _MainTex);
                return o;
            }

            float4 fragment(Varyings i) : SV_Target
            {
                float4 colour = tex2D(_MainTex, i.uv) * _Color;
                return float4(colour.rgb * LpvbakeIrradianceOverPi(i.position, normalize(i.normal)), 1);
            }
            ENDHLSL
        }
    }
}
